/**
 * Note by note: the mistakes of each take, and every due note with how each take played it. A click
 * goes to its place.
 */

import { strokeText } from './classify.js';
import { clockText, element, pitchName } from './dom.js';
import { mistakeList } from './mistakes.js';

/** The scores of a take by note; null without due notes. */
export function summary(take) {
  const { noteScores: scores } = take;
  if (!scores) return null;
  return `${scores.matched} of ${scores.matched + scores.missed} notes right, ${scores.wrong} wrong`;
}

/**
 * @param {{take: any, letter: string}[]} shown one or two takes of the same notes
 * @param {(secs: number, index?: number) => void} seek `index`: of which take
 * @returns {HTMLElement | null} null if no take has due notes, or if two have different ones
 */
export function noteList(shown, seek) {
  const [{ take: first }] = shown;
  const pitches = (take) => take.dueNotes.map((note) => note.pitch).join();
  if (first.dueNotes.length === 0 || shown.some(({ take }) => pitches(take) !== pitches(first))) return null;
  const items = first.dueNotes.map((due, index) => element(
    'li', {},
    element('button', { on: { click: () => seek(due.start) } }, element('span', { class: 'when', text: clockText(due.start) }), ` ${pitchName(due.pitch)}`),
    element('div', {}, ...shown.map(({ take, letter }) => playedText(take, letter, index))),
  ));
  return element(
    'section', { class: 'notes' },
    element('h2', { text: 'Mistakes' }),
    ...shown.map(({ take, letter }, index) => mistakeList(take, letter, (secs) => seek(secs, index))),
    element('h2', { text: 'Note by note: onset, length, velocity' }),
    element('p', { class: 'note', text: 'Onset and length: played minus due, in ms; late and long are positive. In the scores a note more than 50 ms early or late counts as missed, and its stroke as wrong. Velocity: MIDI; a stroke more than 40 above or below the written velocity is too loud or too soft.' }),
    element('ol', {}, ...items),
  );
}

/** How a take played a due note. */
function playedText(take, letter, index) {
  const { kind, start, end } = take.dueNotes[index];
  const note = take.notes[take.matches[index]?.note];
  const stroke = note ? { onset: note.start - start, length: note.end - note.start - (end - start), velocity: note.velocity, right: kind === 'right' } : null;
  return element('p', { class: kind }, letter ? element('span', { class: `take-${letter.toLowerCase()}`, text: `${letter} ` }) : null, strokeText(stroke));
}
