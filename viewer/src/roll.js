/** The piano roll: due and played notes of the whole song; it scrolls if the song is too long. */

import { drawingOn, hatching, moveCursor } from './canvas.js';
import { SAYS } from './classify.js';
import { clockText, element, isBlack, pitchName } from './dom.js';
import { readable } from './names.js';
import { DUE, MISSED, OFF, RIGHT, WRONG, theme } from './theme.js';

/** Least width of a second, in pixels; wider if the whole song fits. */
const MIN_PIXELS_PER_SEC = 30;
/**
 * Height of the roll, spread over the pitches in use within these limits, in pixels. A name fits
 * into the lowest row.
 */
const HEIGHT = 168;
const ROW = { least: 8, most: 12 };
/** Width of the margin with the names, and the least distance of two numbers of bars. */
const MARGIN = 28;
const BARS_APART = 22;
/** At least an octave is shown. */
const MIN_ROWS = 13;

export class Roll {
  /** @param {(secs: number) => void} seek */
  constructor(take, seek) {
    this.take = take;
    this.pitches = [...new Set([...take.dueNotes, ...take.notes].map((note) => note.pitch))];
    this.rows = rowsOf(this.pitches);
    this.rowHeight = Math.min(ROW.most, Math.max(ROW.least, HEIGHT / (this.rows.high - this.rows.low + 1)));
    this.height = Math.round(this.rowHeight * (this.rows.high - this.rows.low + 1));
    this.canvas = element('canvas', {});
    this.cursor = element('div', { class: 'cursor' });
    this.song = element('div', { class: 'song' }, this.canvas, this.cursor);
    this.root = element('div', { class: 'roll', role: 'img', tabindex: '-1', 'aria-label': this.#summary() }, this.song);
    this.root.addEventListener('scroll', () => this.draw(), { passive: true });
    this.root.addEventListener('click', (event) => seek(this.#secsAt(event)));
    this.root.addEventListener('pointermove', (event) => this.#hint(event));
  }

  /**
   * Sizes the roll for `duration`, which may be longer than the take, so that two takes are
   * aligned.
   */
  resize(duration) {
    this.width = this.root.clientWidth;
    this.scale = Math.max(this.width / Math.max(duration, 1e-3), MIN_PIXELS_PER_SEC);
    this.song.style.width = `${Math.max(this.width, Math.floor(this.scale * duration))}px`;
    this.song.style.height = `${this.height}px`;
    this.cursor.style.height = `${this.height}px`;
    this.draw();
  }

  /** Moves the cursor, and scrolls by a page when it leaves the visible part. */
  moveTo(secs, playing) {
    const x = secs * this.scale;
    moveCursor(this.cursor, x);
    const { scrollLeft } = this.root;
    const seen = x >= scrollLeft && x <= scrollLeft + this.width;
    // Only at the moment when it leaves, so that the user can scroll elsewhere while it plays.
    if (!seen && (this.seen || !playing)) this.root.scrollLeft = x - 0.1 * this.width;
    this.seen = seen || !playing;
  }

  draw() {
    if (!this.width) return;
    const pen = drawingOn(this.canvas, this.width, this.height);
    const colours = theme();
    pen.translate(-this.root.scrollLeft, 0);
    this.visible = { from: this.root.scrollLeft / this.scale, to: (this.root.scrollLeft + this.width) / this.scale };
    this.#keyboard(pen, colours);
    this.#bars(pen, colours);
    const shown = (notes) => notes.filter((note) => this.#shows(note.start, note.end));
    const [due, strokes] = [shown(this.take.dueNotes), shown(this.take.notes)];
    for (const note of due) if (note.kind !== 'missed') this.#frame(pen, note, DUE);
    for (const note of strokes) this.#stroke(pen, note, colours);
    // Over the strokes, because a note is missed too if its key is held from the note before.
    const hatch = hatching(pen, MISSED);
    for (const note of due) if (note.kind === 'missed') this.#frame(pen, note, MISSED, hatch);
    pen.fillStyle = colours.paper;
    for (const note of strokes) pen.fillRect(note.start * this.scale, this.#top(note.pitch) + 1, 1.5, this.rowHeight - 2);
    this.#names(pen, colours);
  }

  #keyboard(pen, colours) {
    const left = this.visible.from * this.scale;
    pen.fillStyle = colours.paper;
    pen.fillRect(left, 0, this.width, this.height);
    pen.fillStyle = colours.shade;
    for (let pitch = this.rows.low; pitch <= this.rows.high; pitch += 1) {
      if (isBlack(pitch)) pen.fillRect(left, this.#top(pitch), this.width, this.rowHeight);
    }
  }

  /** Bar lines with the numbers of the bars, in the free row above the notes. */
  #bars(pen, colours) {
    setFont(pen);
    let free = -Infinity;
    this.take.bars.forEach((secs, index) => {
      if (!this.#shows(secs, secs)) return;
      const x = Math.round(secs * this.scale);
      pen.fillStyle = colours.line;
      pen.fillRect(x, 0, 1, this.height);
      if (x < free) return;
      pen.fillStyle = colours.quiet;
      pen.fillText(String(index + 1), x + 4, this.rowHeight / 2 + 0.5);
      free = x + BARS_APART;
    });
  }

  /** The place of a note: left, top, width and height. */
  #place({ pitch, start, end }) {
    return [start * this.scale, this.#top(pitch), (end - start) * this.scale, this.rowHeight];
  }

  /**
   * A key that sounded, from its stroke to its release. The kinds differ in shape and not only in
   * colour.
   */
  #stroke(pen, note, colours) {
    const [x, y, width, height] = this.#place(note);
    if (note.kind === 'wrong') {
      pen.fillStyle = WRONG;
      pen.fillRect(x, y + height * 0.28, width, height * 0.44);
    } else if (note.kind === 'off') {
      pen.globalAlpha = 0.35;
      pen.fillStyle = OFF;
      pen.fillRect(x, y + 1, width, height - 2);
      pen.globalAlpha = 1;
      pen.strokeStyle = OFF;
      pen.lineWidth = 2;
      pen.strokeRect(x + 1, y + 1.5, Math.max(width - 2, 0.5), height - 3);
    } else {
      pen.fillStyle = note.kind === 'right' ? RIGHT : colours.quiet;
      pen.fillRect(x, y + 0.5, width, height - 1);
    }
  }

  /** From when until when a note was due: a frame, filled if it was missed. */
  #frame(pen, note, colour, fill = 'transparent') {
    const [x, y, width, height] = this.#place(note);
    pen.fillStyle = fill;
    pen.fillRect(x, y + 1, width, height - 2);
    pen.strokeStyle = colour;
    pen.lineWidth = 1;
    if (width > 1) pen.strokeRect(x + 0.5, y + 1, width - 1, height - 2);
  }

  /** The names of the keys that occur, in a margin at the left edge of what is seen. */
  #names(pen, colours) {
    const left = this.visible.from * this.scale;
    pen.globalAlpha = 0.85;
    pen.fillStyle = colours.paper;
    pen.fillRect(left, 0, MARGIN, this.height);
    pen.globalAlpha = 1;
    setFont(pen);
    pen.fillStyle = colours.ink;
    for (const pitch of readable(this.pitches, this.rowHeight)) pen.fillText(pitchName(pitch), left + 4, this.#top(pitch) + this.rowHeight / 2 + 0.5);
  }

  #top(pitch) {
    return (this.rows.high - pitch) * this.rowHeight;
  }

  #shows(from, to) {
    return to >= this.visible.from && from <= this.visible.to;
  }

  #secsAt(event) {
    return (event.clientX - this.root.getBoundingClientRect().left + this.root.scrollLeft) / this.scale;
  }

  /** Shows the note under the pointer as a tooltip. */
  #hint(event) {
    const secs = this.#secsAt(event);
    const pitch = this.rows.high - Math.floor((event.clientY - this.root.getBoundingClientRect().top) / this.rowHeight);
    const [due, stroke] = [this.take.dueAt(pitch, secs), this.take.strokeAt(pitch, secs)];
    const about = (note, how) => note && `${SAYS[note.kind]}, ${how} from ${clockText(note.start)} to ${clockText(note.end)}`;
    const found = [about(due, 'due'), about(stroke, 'held')].filter(Boolean);
    const says = found.length > 0 ? `${pitchName(pitch)}: ${found.join('; ')}` : '';
    if (this.root.title !== says) this.root.title = says;
  }

  #summary() {
    const { notes, dueNotes, isJudged } = this.take;
    if (!isJudged) return `Piano roll. Strokes: ${notes.length}.`;
    const count = (all, kind) => all.filter((note) => note.kind === kind).length;
    const due = ['right', 'off', 'missed'].map((kind) => `${count(dueNotes, kind)} ${SAYS[kind]}`);
    return `Piano roll. Notes: ${due.join(', ')}. Wrong strokes: ${count(notes, 'wrong')}.`;
  }
}

function setFont(pen) {
  pen.font = '10px system-ui, sans-serif';
  pen.textBaseline = 'middle';
}

function rowsOf(pitches) {
  let [low, high] = pitches.length > 0 ? [Math.min(...pitches) - 1, Math.max(...pitches) + 1] : [60, 73];
  while (high - low + 1 < MIN_ROWS) {
    high += 1;
    if (high - low + 1 < MIN_ROWS) low -= 1;
  }
  return { low, high };
}
