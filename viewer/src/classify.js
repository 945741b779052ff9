/** The kinds of strokes and due notes in roll, keys and list of mistakes. */

/** The names of the kinds. */
export const SAYS = { right: 'right', off: 'too early or too late', missed: 'missed', wrong: 'wrong stroke', played: 'played' };

/** The kind of a due note by its stroke. */
export function noteKind(match) {
  if (!match) return 'missed';
  return match.right ? 'right' : 'off';
}

/**
 * The kind of each stroke: that of its note, or `wrong` without one.
 * @param {number} count of strokes
 * @param {({note: number, right: boolean} | null)[]} matches the stroke of each due note
 */
export function strokeKinds(count, matches) {
  const kinds = new Array(count).fill('wrong');
  for (const one of matches) if (one && one.note in kinds) kinds[one.note] = noteKind(one);
  return kinds;
}

/**
 * What a key shows.
 * @param {{start: number, kind: string} | undefined} due the note of the key that is due now
 * @param {{start: number, kind: string} | undefined} stroke the stroke that sounds now
 * @returns {string | null} `due` while the stroke of a due note is still to come or is over
 */
export function keyKind(due, stroke) {
  // A key that is held from the note before does not play the next one.
  if (due?.kind === 'missed' && !(stroke?.start > due.start)) return 'missed';
  return stroke?.kind ?? (due ? 'due' : null);
}

/** A difference in ms with its sign. */
function signedMs(secs) {
  const whole = Math.round(secs * 1e3);
  return `${whole > 0 ? '+' : whole < 0 ? '−' : ''}${Math.abs(whole)}`;
}

/**
 * How a due note was played: onset and length, played minus due, in ms, and velocity.
 * @param {{onset: number, length: number, velocity: number, right: boolean} | null} stroke times in
 *   s
 */
export function strokeText(stroke) {
  if (stroke === null) return 'missed';
  const { onset, length, velocity, right } = stroke;
  return `${signedMs(onset)}, ${signedMs(length)}, ${velocity}${right ? '' : `, too ${onset > 0 ? 'late' : 'early'}`}`;
}
