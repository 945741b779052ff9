/** The chosen song: its hard places, its reference sound, and its actions. */

import { element } from '../dom.js';
import * as api from './api.js';
import { Section, button, choice, field, playerText, scoreText, table, timeText } from './parts.js';

/** The modes of `etude perform`, and what they mean. */
const MODES = [
  ['real', 'real: it observes the robot'],
  ['hybrid', 'hybrid: it observes the simulation and the robot’s keys'],
  ['joint-mirroring', 'joint-mirroring: it observes the simulation'],
];
/** Hard places that are shown; the others are folded. */
const MAX_SHOWN = 6;

export class SongSection {
  /**
   * @param {(request: any) => Promise<void>} start starts a verb
   * @param {(known: any) => Promise<void>} analyse runs `etude songs show` on the song
   */
  constructor(start, analyse) {
    this.start = start;
    this.analyse = analyse;
    this.about = new Section('');
    this.actions = new Section('Play, perform, train');
    this.root = element('div', { class: 'song' }, this.about.root, this.actions.root);
    this.root.hidden = true;
  }

  /**
   * Shows a song and gives its description.
   *
   * @param {string} song
   * @param {boolean} analyses whether `etude songs show` runs if its output is missing
   */
  async choose(song, analyses = true) {
    if (this.song !== song) this.root.hidden = true;
    this.song = song;
    const known = await api.about(song);
    const text = known.is_ready || !analyses ? await api.json(known.about) : null;
    // Another song may have been chosen meanwhile.
    if (this.song !== song) return known;
    this.root.hidden = false;
    this.about.heading.textContent = known.title;
    this.showAbout(known, text);
    this.showActions(known);
    if (text === null && known.problem === null && analyses) await this.analyse(known);
    return known;
  }

  showAbout(known, text) {
    this.about.show([known, text], () => {
      if (known.problem !== null) return this.problem(known);
      if (text === null) return [element('p', { class: 'note', text: 'Reading the song and planning the fingering…' })];
      const busiest = text.busiest_second;
      const facts = [
        `${text.notes} notes in ${timeText(text.secs)}`,
        `${text.notes_per_sec.toFixed(1)} a second`,
        busiest && `${busiest.notes} in the busiest second, in bar ${busiest.bar}`,
      ].filter(Boolean);
      return [
        element('p', { text: `${facts.join('; ')}.` }),
        element(
          'figure', { class: 'sound' }, element('figcaption', { text: 'As written' }),
          element('audio', { controls: true, preload: 'metadata', src: api.address(known.reference), 'data-key': 'reference', 'aria-label': 'As written' }),
        ),
        ...this.hard(known.song, text),
        ...this.bars(text.bars),
      ];
    });
  }

  /** Why the song is outside the keyboard, and the transpositions and omissions that mend it. */
  problem({ song, problem, transpositions, outside, notes }) {
    const start = (changes) => this.start({ verb: 'arrange', song, changes });
    const offers = transpositions.map((semitones) => {
      const text = `${semitones > 0 ? '+' : '−'}${Math.abs(semitones)}`;
      return button(text, `transpose${semitones}`, () => start({ transpose: semitones }), { 'aria-label': `Transpose by ${text} semitones` });
    });
    const without = `Leave out ${outside} ${outside === 1 ? 'note' : 'notes'}`;
    return [
      element('p', { class: 'problem', text: problem }),
      offers.length > 0 ? element('p', { class: 'row' }, element('span', { text: 'Transpose by semitones:' }), ...offers) : null,
      outside > 0 && outside < notes
        ? element('p', { class: 'row' }, button(without, 'within-range', () => start({ within_range: true })), element('span', { text: `Keeps ${notes - outside} of ${notes} notes.` }))
        : null,
    ];
  }

  hard(song, { warnings, fingering, notes, zero_shot: zeroShot, easier }) {
    const items = [
      ...warnings,
      ...(fingering?.limits ?? []).map((limit) => `bar ${limit.bar}, beat ${Number(limit.beat.toFixed(2))} (${limit.secs.toFixed(2)} s): ${limit.note} ${limit.what}`),
    ];
    const list = (texts) => element('ul', {}, ...texts.map((text) => element('li', { text })));
    return [
      element('h3', { text: 'Hard places' }),
      fingering ? element('p', { text: `With three fingers: ${fingering.summary}.` }) : null,
      zeroShot ? element('p', { text: `Predicted zero-shot: ${zeroShot.notes_right} of ${notes} notes, ${scoreText(zeroShot.f1)}.` }) : null,
      easier ? this.easier(song, easier) : null,
      items.length === 0 ? element('p', { class: 'note', text: 'None: the hand reaches every note in time.' }) : list(items.slice(0, MAX_SHOWN)),
      items.length > MAX_SHOWN
        ? element('details', {}, element('summary', { text: `${items.length - MAX_SHOWN} more` }), list(items.slice(MAX_SHOWN)))
        : null,
    ];
  }

  /** An arrangement with fewer omitted notes. */
  easier(song, { stretch, melody, notes, left_out: leftOut }) {
    const how = [stretch === 1 ? null : `${stretch} times as long`, melody ? 'the upper voice alone' : null].filter(Boolean).join(', ');
    return element(
      'p', { class: 'row' }, element('span', { text: `Easier: ${how}, ${notes - leftOut} of ${notes} notes.` }),
      button('Write this arrangement', 'easier', () => this.start({ verb: 'arrange', song, changes: { stretch, melody } })),
    );
  }

  bars(bars) {
    // Lines break between chords, not between a note and its beats.
    const written = (chords) => element('span', { class: 'wide' }, ...chords.flatMap((text) => [element('span', { text }), '   ']).slice(0, -1));
    const rows = bars.map(({ bar, secs, chords }) => [String(bar), `${secs.toFixed(1)} s`, written(chords)]);
    return [
      element(
        'details', {}, element('summary', { text: `${bars.length} bars: notes and their length in beats` }),
        table('Notes by bar', ['bar', 'at', 'notes and beats; + joins a chord'], rows),
      ),
    ];
  }

  showActions(known) {
    const { song, problem, policy, policy_f1: f1, zero_shot: zeroShot } = known;
    this.actions.show([song, problem, policy, f1, zeroShot], () => {
      if (problem !== null) return null;
      const players = policy === null
        ? [['scripted', 'the scripted baseline']]
        : [['best', `${playerText(policy)}${typeof f1 === 'number' ? `, ${scoreText(f1)} ${zeroShot ? 'on other melodies' : 'in training'}` : ''}`], ['scripted', 'the scripted baseline']];
      const player = choice(players, { 'data-key': 'player' });
      const mode = choice(MODES, { 'data-key': 'mode' });
      const minutes = element('input', { type: 'number', min: '0.1', step: 'any', placeholder: 'no limit', 'data-key': 'minutes' });
      const set = element('input', { type: 'text', placeholder: 'trainer.total_steps=60000', autocomplete: 'off', spellcheck: 'false', 'data-key': 'set' });
      return [
        policy === null
          ? element('p', { text: 'No policy can play this song. The scripted baseline plays it: by inverse kinematics and timing, without learning.' })
          : null,
        zeroShot
          ? element('p', { text: 'No policy has learned this song yet. The sight-reader plays it zero-shot: a policy that has learned other melodies.' })
          : null,
        element('div', { class: 'row' }, field('Player', player), button('Play it', 'play', () => this.start({ verb: 'play', song, player: player.value }))),
        element(
          'div', { class: 'row' }, field('Mode', mode),
          button('Perform it on the twin', 'perform', () => this.start({ verb: 'perform', song, player: player.value, mode: mode.value })),
        ),
        element(
          'div', { class: 'row' }, field('Minutes', minutes), field('Settings', set),
          button('Train a policy', 'train', () => {
            const limit = minutes.value === '' ? null : Number(minutes.value);
            return this.start({ verb: 'train', song, minutes: limit, set: set.value.split(/\s+/).filter(Boolean) });
          }),
        ),
        element('p', { class: 'quiet', text: 'A training takes one to five minutes, depending on the processor.' }),
      ];
    });
  }
}
