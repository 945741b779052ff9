/** What the roll and the keys show: strokes and due notes by the same rule as the list of mistakes, so that a word means one thing on the page. */

/** What each kind is called. */
export const SAYS = { right: 'right', off: 'too early or too late', missed: 'missed', wrong: 'wrong stroke', played: 'played' };

/** The kind of a due note by the stroke that played it. */
export function noteKind(heard) {
  if (!heard) return 'missed';
  return heard.right ? 'right' : 'off';
}

/**
 * The kind of each stroke: that of the note which it plays, or `wrong` if it plays none.
 * @param {number} count of strokes
 * @param {({note: number, right: boolean} | null)[]} heard by which stroke each due note was played
 */
export function strokeKinds(count, heard) {
  const kinds = new Array(count).fill('wrong');
  for (const one of heard) if (one && one.note in kinds) kinds[one.note] = noteKind(one);
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
 * @param {{onset: number, length: number, velocity: number, right: boolean} | null} stroke times in s
 */
export function strokeText(stroke) {
  if (stroke === null) return 'missed';
  const { onset, length, velocity, right } = stroke;
  return `${signedMs(onset)}, ${signedMs(length)}, ${velocity}${right ? '' : `, too ${onset > 0 ? 'late' : 'early'}`}`;
}
