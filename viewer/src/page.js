/** The page: its parts, their layout, and the work of each frame. */

import { Cameras } from './cameras.js';
import { SAYS } from './classify.js';
import { Player, Timebase, barAround } from './clock.js';
import { Controls, icon } from './controls.js';
import { element } from './dom.js';
import { noteList, summary } from './notes.js';
import { Pane } from './pane.js';
import { Plots } from './plots.js';
import { Quality } from './quality.js';
import { Roll } from './roll.js';
import { Sound } from './sound.js';
import { onThemeChange } from './theme.js';
import { Timeline } from './timeline.js';

const MAX_PANES = 2;
/**
 * Interval between updates of cursors and numbers on a slow machine, so that the scene moves in
 * every frame.
 */
const SLOW_MARKS_SECS = 0.1;
const SETTLED_MS = 250;

export class Page {
  /**
   * @param {HTMLElement} root
   * @param {import('./take.js').Take[]} takes at least one
   * @param {[number, number][]} differences where the first two takes sound different keys
   */
  constructor(root, takes, differences) {
    this.takes = takes;
    this.differences = differences;
    this.muted = false;
    this.readyMs = null;
    this.stale = true;
    this.settled = false;
    this.drawn = 0;
    this.quality = new Quality();
    this.timebase = new Timebase();
    this.player = new Player(this.timebase, 0);
    this.sound = new Sound(this.player, this.timebase);
    this.cameras = new Cameras(() => {
      this.stale = true;
    });
    const count = Math.min(takes.length, MAX_PANES);
    this.letters = count > 1 ? ['A', 'B'] : [''];
    this.panes = this.letters.map((letter) => new Pane(this.cameras, letter));
    // The last pane is audible: that of the twin or the robot, if there is also a simulation.
    this.audible = count - 1;
    this.written = false;
    this.timeline = new Timeline(this.player);
    this.controls = new Controls(this.#actions(), this.player, count > 1 ? this.letters : []);
    this.begin = element('button', { type: 'button', class: 'begin', on: { click: () => this.play() } }, icon('play'), 'Play with sound');
    this.keyColours = element('p', { class: 'key-colours' });
    this.rolls = element('section', { class: 'rolls' });
    this.notes = null;
    this.plots = null;
    this.chosen = this.panes.map((_, index) => index);
    root.append(
      element('header', {}, element('h1', { text: titleOf(takes) }), element('span', { class: 'brand', text: 'Étude replay' })),
      element('main', {},
        element('div', { class: count > 1 ? 'panes two' : 'panes' }, ...this.panes.map((pane) => pane.root), this.begin),
        this.keyColours,
        element('div', { class: 'desk' }, this.controls.root, this.timeline.root),
        this.timeline.details,
        this.rolls),
    );
    this.main = root.querySelector('main');
    this.#fill();
    this.player.seek(this.#firstNote());
    this.player.changed = () => this.#moved();
    new ResizeObserver(() => this.#layOut()).observe(root);
    onThemeChange(() => {
      for (const pane of this.panes) pane.dress();
      this.#layOut();
    });
    const loop = (now) => {
      this.#frame(now);
      requestAnimationFrame(loop);
    };
    loop(performance.now());
  }

  /** Shows the chosen takes in their panes. */
  #fill() {
    const shown = this.panes.map((pane, index) => ({ take: this.takes[this.chosen[index]], letter: pane.letter }));
    const seek = (secs) => this.seek(secs);
    this.player.duration = Math.max(...shown.map(({ take }) => take.duration));
    shown.forEach(({ take }, index) => this.panes[index].show(take, this.#caption(take, index)));
    const fences = shown.some(({ take }) => take.scene.geoms.some((geom) => geom.name?.startsWith('fence')));
    const { played, ...judged } = SAYS;
    const kinds = shown.some(({ take }) => take.isJudged) && { due: 'due', ...judged };
    this.keyColours.replaceChildren(legend({ ...kinds, ...(fences && { fence: 'fence between keys' }) }));
    this.#listen();
    const firstTwo = shown.length > 1 && [...this.chosen].sort().join() === '0,1';
    this.timeline.show(shown, firstTwo ? this.differences : []);
    this.rollViews = shown.map(({ take }) => new Roll(take, seek));
    this.rolls.replaceChildren(
      element('h2', { text: 'Piano roll' }, legend({ ...kinds, ...(shown.some(({ take }) => !take.isJudged) && { played }) })),
      ...this.rollViews.flatMap((roll, index) => [
        shown.length > 1 ? element('p', { class: `whose take-${'ab'[index]}`, text: `${shown[index].letter} · ${shown[index].take.caption()}` }) : null,
        roll.root,
      ]).filter((part) => part !== null),
    );
    this.notes?.remove();
    this.plots?.root.remove();
    this.notes = noteList(shown, (secs, index = 0) => {
      this.seek(secs);
      this.panes[index].reveal();
    });
    this.plots = new Plots(shown, seek);
    this.main.append(...[this.notes, this.plots.root].filter((part) => part !== null));
    this.#layOut();
  }

  /**
   * When the first note is due in every pane, so that the page opens with its key lit; without due
   * notes the first stroke.
   */
  #firstNote() {
    const starts = this.panes.map(({ take }) => (take.dueNotes[0] ?? take.notes[0])?.start ?? 0);
    return Math.max(...starts);
  }

  #caption(take, index) {
    const parts = [];
    const song = this.takes.some((other) => other.song !== take.song) ? take.song : '';
    if (this.letters[index]) parts.push(element('span', { class: `letter take-${'ab'[index]}`, text: this.letters[index] }));
    if (this.takes.length > MAX_PANES) parts.push(this.#chooser(index));
    parts.push(element('span', { class: 'what', text: [song, take.caption() || take.name].filter(Boolean).join(' · '), title: take.name }));
    const scores = summary(take);
    if (scores) parts.push(element('span', { class: 'score', text: scores }));
    const { final } = take;
    const says = (value) => (Number.isFinite(value) ? value.toFixed(3) : '–');
    if (final) {
      const more = `precision ${says(final.precision)}, recall ${says(final.recall)}, pooled F1 ${says(final.pooled_f1)}`;
      parts.push(element('span', { class: 'score', title: more }, 'F1 by control step ', element('b', { text: says(final.f1) })));
    }
    return parts;
  }

  /** A choice of the take that a pane shows. */
  #chooser(index) {
    const options = this.takes.map((take, number) => {
      const option = element('option', { value: String(number), text: take.name || `take ${number + 1}` });
      option.selected = number === this.chosen[index];
      return option;
    });
    const select = element('select', { 'aria-label': `Take ${this.letters[index]}` }, ...options);
    select.addEventListener('change', () => {
      this.chosen[index] = Number(select.value);
      this.#fill();
      this.player.seek(this.player.time());
    });
    return select;
  }

  #actions() {
    const { player, sound } = this;
    return {
      togglePlay: () => (player.playing ? player.pause() : this.play()),
      toggleHalf: () => player.setSpeed(player.speed === 1 ? 0.5 : 1),
      toggleLoop: () => this.toggleLoop(),
      toggleMute: () => {
        this.muted = !this.muted;
        sound.setMuted(this.muted);
        this.#showState();
      },
      setVolume: (volume) => sound.setVolume(volume),
      setCamera: (name) => this.setCamera(name),
      stepBy: (steps) => {
        const { hz } = this.panes[0].take;
        player.pause();
        this.seek((Math.round(player.time() * hz) + steps) / hz);
      },
      seek: (secs) => this.seek(secs),
      listenTo: (pane) => {
        this.audible = pane;
        this.written = false;
        this.#listen();
      },
      toggleWritten: () => {
        this.written = !this.written;
        this.#listen();
      },
    };
  }

  /** Lets the chosen take sound, or its song as written. */
  #listen() {
    const { notes, dueNotes } = this.panes[this.audible].take;
    this.written &&= dueNotes.length > 0;
    this.sound.listenTo(this.written ? dueNotes : notes);
    this.#showState();
  }

  play() {
    this.begin.remove();
    this.sound.begin();
    this.quality.begin();
    this.player.play();
  }

  seek(secs) {
    this.player.seek(secs);
  }

  setCamera(name) {
    this.cameras.choose(name);
    this.#showState();
  }

  toggleLoop() {
    const { player } = this;
    player.setLoop(player.loop ? null : barAround(this.panes[0].take.bars, player.time(), player.duration));
  }

  /** The place, speed or loop has changed. */
  #moved() {
    this.settled = false;
    this.sound.restart();
    this.timeline.resize();
    this.#showState();
    this.#draw();
  }

  #showState() {
    const { muted, audible, written } = this;
    const writable = this.panes[audible].take.dueNotes.length > 0;
    this.controls.update({ muted, camera: this.cameras.view.name, audible, written, writable });
  }

  #layOut() {
    const { duration } = this.player;
    this.timeline.resize();
    for (const roll of this.rollViews) roll.resize(duration);
    this.plots.resize(duration);
    this.#showState();
    this.#draw();
  }

  #frame(now) {
    const { playing } = this.player;
    // A still picture is drawn once more, at the best quality.
    const settling = !playing && !this.settled && now - this.drawn > SETTLED_MS;
    if (!playing && !this.stale && !settling) return;
    this.settled = settling && !this.stale;
    if (playing) this.quality.frame(now);
    this.#draw();
  }

  #draw() {
    const { player, quality } = this;
    const secs = player.time();
    const ratio = this.settled ? quality.finest : quality.ratio;
    for (const pane of this.panes) {
      pane.resize(ratio);
      pane.draw(secs);
    }
    if (!player.playing || !quality.slow || Math.abs(secs - this.marked) >= SLOW_MARKS_SECS) this.#mark(secs);
    this.stale = false;
    this.drawn = performance.now();
    this.readyMs ??= performance.now();
  }

  /** Moves everything except the scenes to a place. */
  #mark(secs) {
    this.marked = secs;
    this.timeline.moveTo(secs);
    this.controls.moveTo(secs);
    for (const pane of this.panes) pane.mark(secs);
    for (const roll of this.rollViews) roll.moveTo(secs, this.player.playing);
    this.plots.moveTo(secs);
  }
}

/** The song; with takes of two songs both, with more their number. */
function titleOf(takes) {
  const songs = [...new Set(takes.map((take) => take.song || take.name))];
  return (songs.length > 2 ? `${songs.length} songs` : songs.join(' and ')) || 'Replay';
}

/** @param {Object<string, string>} kinds what each kind is called */
function legend(kinds) {
  const item = ([kind, text]) => element('span', { class: 'item' }, element('i', { class: `swatch ${kind}` }), text);
  return element('span', { class: 'legend' }, ...Object.entries(kinds).map(item));
}
