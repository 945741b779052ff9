/** One recording, looked up by time; gaps of an incomplete recording are filled. */

import { noteKind, strokeKinds } from './classify.js';

/** Duration of a drawn key movement, s. The key event is in its middle, when the contact closes. */
const KEY_RAMP_SECS = 0.03;

const list = (value) => (Array.isArray(value) ? value : []);

export class Take {
  constructor(raw) {
    const take = raw ?? {};
    this.name = String(take.name ?? '');
    this.song = String(take.song ?? '');
    this.who = String(take.who ?? '');
    this.rig = String(take.rig ?? '');
    this.mode = String(take.mode ?? '');
    this.hz = take.control_hz > 0 ? take.control_hz : 20;
    /** How much earlier than written the player plays, s: control steps are earlier by this. */
    this.early = take.early_secs > 0 ? take.early_secs : 0;
    this.bars = list(take.bar_secs);
    this.joints = list(take.joints);
    this.scene = { bodies: list(take.scene?.bodies), geoms: list(take.scene?.geoms) };
    this.due = list(take.due).map(list);
    this.pressed = list(take.pressed).map(list);
    this.start = Array.isArray(take.start) ? take.start : null;
    this.positions = filled(list(take.positions), this.start, this.joints.length);
    /**
     * The robot's arm: radii of its links, and points along them, a row a control step; null
     * without one.
     */
    this.arm = list(take.arm?.points).length > 0 ? { radii: list(take.arm.radii), points: list(take.arm.points) } : null;
    this.running = take.running ?? {};
    this.final = take.final ?? null;
    this.rewards = list(take.rewards);
    this.rewardsNote = take.rewards_note ? String(take.rewards_note) : null;
    this.marks = list(take.marks);
    this.steps = Math.max(this.positions.length, this.due.length, this.pressed.length);
    const notes = list(take.notes);
    this.duration = Math.max(this.steps / this.hz - this.early, ...notes.map((note) => note.end ?? note.start));
    const dueNotes = list(take.due_notes);
    /** The stroke of each due note: `{note, right}` with an index of `notes`, or null. */
    this.matches = dueNotes.map((_, index) => list(take.matches)[index] ?? null);
    /** Whether the due notes are known, not only the due keys of each step. */
    this.isJudged = dueNotes.length > 0 || this.due.every((pitches) => pitches.length === 0);
    const kinds = strokeKinds(notes.length, this.matches);
    this.notes = notes.map((note, index) => ({ ...note, end: note.end ?? this.duration, kind: this.isJudged ? kinds[index] : 'played' }));
    this.dueNotes = dueNotes.map((note, index) => ({ ...note, kind: noteKind(this.matches[index]) }));
    this.noteScores = take.note_scores ?? null;
    /** Strokes and due notes by pitch. */
    [this.notesOf, this.dueOf] = [byPitch(this.notes), byPitch(this.dueNotes)];
    this.remarks = remarks(take, this);
  }

  /** The control step that ends at a time, with its fraction; −1 at the beginning of the first. */
  stepAt(secs) {
    return (secs + this.early) * this.hz - 1;
  }

  /** When a control step ends. */
  endOf(step) {
    return (step + 1) / this.hz - this.early;
  }

  /** The last control step that has ended at a time; −1 before the first. */
  stepBefore(secs) {
    return Math.min(Math.floor(this.stepAt(secs) + 1e-6), this.steps - 1);
  }

  /**
   * Joint positions at a time into `out`: a smooth curve through the recorded rows (Catmull–Rom).
   */
  positionsAt(secs, out) {
    const last = this.positions.length - 1;
    if (last < 0) return out.fill(0);
    const place = Math.min(Math.max(this.stepAt(secs), this.start ? -1 : 0), last);
    const index = Math.floor(place);
    const u = place - index;
    const row = (i) => this.positions[Math.min(Math.max(i, 0), last)];
    const at = (i) => (i < 0 && this.start ? this.start : row(i));
    const [a, b, c, d] = [at(index - 1), at(index), at(index + 1), at(index + 2)];
    for (let joint = 0; joint < out.length; joint += 1) {
      const [p, q, r, s] = [a[joint], b[joint], c[joint], d[joint]];
      out[joint] = q + 0.5 * u * (r - p + u * (2 * p - 5 * q + 4 * r - s + u * (3 * (q - r) + s - p)));
    }
    return out;
  }

  /** Points of the arm at a time: x, y and z of each in a row. */
  armAt(secs) {
    const { points } = this.arm;
    const place = Math.min(Math.max(this.stepAt(secs), 0), points.length - 1);
    const [from, to] = [points[Math.floor(place)], points[Math.ceil(place)]];
    return from.map((value, index) => value + (place % 1) * (to[index] - value));
  }

  /** The due note of a key at a time. */
  dueAt(pitch, secs) {
    return this.dueOf.get(pitch)?.findLast((note) => note.start <= secs + 1e-6 && secs < note.end);
  }

  /** The stroke of a key that sounds at a time. */
  strokeAt(pitch, secs) {
    return this.notesOf.get(pitch)?.findLast((note) => note.start < secs && secs < note.end);
  }

  /** How far down a key is drawn at a time, from 0 to 1. */
  keyDepth(pitch, secs) {
    let depth = 0;
    for (const note of this.notesOf.get(pitch) ?? []) {
      const inside = Math.min(secs - note.start, note.end - secs) / KEY_RAMP_SECS + 0.5;
      depth = Math.max(depth, Math.min(inside, 1));
    }
    return depth;
  }

  /** A short description: rig, mode and who played. */
  caption() {
    return [this.rig, this.mode, this.who].filter((part) => part !== '').join(' · ');
  }
}

/** @returns {Map<number, any[]>} */
function byPitch(notes) {
  const found = new Map();
  for (const note of notes) found.set(note.pitch, [...(found.get(note.pitch) ?? []), note]);
  return found;
}

/** Rows without gaps: missing values (JSON has no NaN) keep the value before. */
function filled(rows, start, width) {
  let previous = start ?? new Array(width).fill(0);
  return rows.map((row) => {
    previous = previous.map((value, joint) => (Number.isFinite(row?.[joint]) ? row[joint] : value));
    return previous;
  });
}

/** Remarks on what the recording does not contain. */
function remarks(raw, take) {
  const found = [];
  if (raw.incomplete) found.push(String(raw.incomplete));
  if (take.steps === 0) found.push('This recording has no control step, so nothing moves.');
  else if (take.positions.length === 0) found.push('This recording has no joint positions, so the hand does not move.');
  if (take.steps > 0 && take.due.length === 0) found.push('This recording has no song and no scores.');
  else if (take.steps > 0 && take.due.every((pitches) => pitches.length === 0)) {
    found.push('No note was due in this recording: every stroke is wrong.');
  } else if (!take.isJudged) {
    found.push('This recording has no due notes: its strokes are not judged.');
  }
  return found;
}
