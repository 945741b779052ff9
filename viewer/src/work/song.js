/** The chosen song: what will be hard, how it should sound, and what can be done with it. */

import { element } from '../dom.js';
import * as ask from './ask.js';
import { Section, button, choice, field, playerText, scoreText, table, timeText } from './parts.js';

/** The modes of `etude perform`, and what they mean. */
const MODES = [
  ['real', 'real: it observes the robot'],
  ['hybrid', 'hybrid: it observes the simulation and the robot’s keys'],
  ['joint-mirroring', 'joint-mirroring: it observes the simulation'],
];
/** Bars, and things that will be hard, that are shown at once; the others are behind a fold. */
const FIRST = 6;

export class SongSection {
  /**
   * @param {(wanted: any) => Promise<void>} start starts a verb
   * @param {(known: any) => Promise<void>} read lets `etude songs show` read the song
   */
  constructor(start, read) {
    this.start = start;
    this.letRead = read;
    this.about = new Section('');
    this.actions = new Section('Play, perform, train');
    this.root = element('div', { class: 'song' }, this.about.root, this.actions.root);
    this.root.hidden = true;
  }

  /**
   * Shows what is known of a song, and gives it.
   *
   * @param {string} song
   * @param {boolean} reads whether `etude songs show` reads it if its files are not there
   */
  async choose(song, reads = true) {
    if (this.song !== song) this.root.hidden = true;
    this.song = song;
    const known = await ask.about(song);
    const text = known.is_there || !reads ? await ask.json(known.about) : null;
    // Meanwhile another one may have been chosen.
    if (this.song !== song) return known;
    this.root.hidden = false;
    this.about.heading.textContent = known.title;
    this.showAbout(known, text);
    this.showActions(known);
    if (text === null && known.problem === null && reads) await this.letRead(known);
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
          'figure', { class: 'sound' }, element('figcaption', { text: 'How it should sound' }),
          element('audio', { controls: true, preload: 'metadata', src: ask.address(known.reference), 'data-key': 'reference', 'aria-label': 'How it should sound' }),
        ),
        ...this.hard(known.song, text),
        ...this.bars(text.bars),
      ];
    });
  }

  /** Why the keyboard cannot play it, and the transpositions with which it can. */
  problem(known) {
    const offers = known.transpositions.map((semitones) => {
      const text = `${semitones > 0 ? '+' : '−'}${Math.abs(semitones)}`;
      const wanted = { verb: 'arrange', song: known.song, transpose: semitones };
      return button(text, `transpose${semitones}`, () => this.start(wanted), { 'aria-label': `Transpose by ${text} semitones` });
    });
    return [
      element('p', { class: 'problem', text: known.problem }),
      offers.length > 0 ? element('p', { class: 'row' }, element('span', { text: 'Transpose by semitones:' }), ...offers) : null,
    ];
  }

  hard(song, { warnings, fingering, notes, at_sight: atSight, easier }) {
    const items = [
      ...warnings,
      ...(fingering?.limits ?? []).map((limit) => `bar ${limit.bar}, beat ${Number(limit.beat.toFixed(2))} (${limit.secs.toFixed(2)} s): ${limit.note} ${limit.what}`),
    ];
    const list = (texts) => element('ul', {}, ...texts.map((text) => element('li', { text })));
    return [
      element('h3', { text: 'What will be hard' }),
      fingering ? element('p', { text: `With three fingers: ${fingering.summary}.` }) : null,
      atSight ? element('p', { text: `Predicted at sight: ${atSight.notes_right} of ${notes} notes, ${scoreText(atSight.f1)}.` }) : null,
      easier ? this.easier(song, easier) : null,
      items.length === 0 ? element('p', { class: 'note', text: 'Nothing: the hand reaches every note in time.' }) : list(items.slice(0, FIRST)),
      items.length > FIRST
        ? element('details', {}, element('summary', { text: `${items.length - FIRST} more` }), list(items.slice(FIRST)))
        : null,
    ];
  }

  /** An arrangement of which the hand leaves out less. */
  easier(song, { stretch, melody, notes, left_out: leftOut }) {
    const how = [stretch === 1 ? null : `${stretch} times as long`, melody ? 'the upper voice alone' : null].filter(Boolean).join(', ');
    return element(
      'p', { class: 'row' }, element('span', { text: `Easier: ${how}, ${notes - leftOut} of ${notes} notes.` }),
      button('Write this arrangement', 'easier', () => this.start({ verb: 'arrange', song, stretch, melody })),
    );
  }

  bars(bars) {
    // A line breaks between chords, and not between a note and its beats.
    const written = (chords) => element('span', { class: 'wide' }, ...chords.flatMap((text) => [element('span', { text }), '   ']).slice(0, -1));
    const rows = bars.map(({ bar, secs, chords }) => [String(bar), `${secs.toFixed(1)} s`, written(chords)]);
    return [
      element(
        'details', {}, element('summary', { text: `Its ${bars.length} bars: notes, and the beats that they last` }),
        table('Notes by bar', ['bar', 'at', 'notes and beats, together with +'], rows),
      ),
    ];
  }

  showActions(known) {
    const { song, problem, policy, policy_f1: f1, at_sight: atSight } = known;
    this.actions.show([song, problem, policy, f1, atSight], () => {
      if (problem !== null) return null;
      const players = policy === null
        ? [['scripted', 'the scripted player']]
        : [['best', `${playerText(policy)}${typeof f1 === 'number' ? `, ${scoreText(f1)} ${atSight ? 'on other melodies' : 'in training'}` : ''}`], ['scripted', 'the scripted player']];
      const player = choice(players, { 'data-key': 'player' });
      const mode = choice(MODES, { 'data-key': 'mode' });
      const minutes = element('input', { type: 'number', min: '0.1', step: 'any', placeholder: 'no limit', 'data-key': 'minutes' });
      const set = element('input', { type: 'text', placeholder: 'trainer.total_steps=60000', autocomplete: 'off', spellcheck: 'false', 'data-key': 'set' });
      return [
        policy === null
          ? element('p', { text: 'There is no policy that can play this song. The scripted player plays it: by inverse kinematics and timing, without learning.' })
          : null,
        atSight
          ? element('p', { text: 'No policy has learned this song yet. The sight-reader plays it at sight: a policy that has learned other melodies.' })
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
