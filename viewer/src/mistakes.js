/** The mistakes of a take, by kind, above the note table. A click goes to the place. */

import { clockText, element, pitchName } from './dom.js';

/**
 * Difference of played and written velocity (MIDI) from which on a note is too loud or too soft.
 */
const VELOCITY_TOLERANCE = 40;

const KINDS = ['missed', 'too early', 'too late', 'wrong stroke', 'too loud', 'too soft'];

const ms = (secs) => `${Math.abs(secs * 1000).toFixed(0)} ms`;

/**
 * @returns {{kind: string, secs: number, pitch: number, more: string}[]} notes of the song first,
 *   then strokes that play none
 */
export function mistakes(take) {
  const found = [];
  // A song of one velocity has no dynamics.
  const dynamic = new Set(take.dueNotes.map((due) => due.velocity)).size > 1;
  take.dueNotes.forEach((due, index) => {
    const match = take.matches[index];
    const note = match && take.notes[match.note];
    const add = (kind, more) => found.push({ kind, secs: due.start, pitch: due.pitch, more });
    if (!note) return add('missed', '');
    const error = note.start - due.start;
    if (!match.right) add(error > 0 ? 'too late' : 'too early', `${ms(error)} ${error > 0 ? 'late' : 'early'}`);
    const louder = note.velocity - due.velocity;
    if (dynamic && Math.abs(louder) > VELOCITY_TOLERANCE) add(louder > 0 ? 'too loud' : 'too soft', `${note.velocity}, not ${due.velocity}`);
  });
  for (const note of take.notes.filter(({ kind }) => kind === 'wrong')) {
    found.push({ kind: 'wrong stroke', secs: note.start, pitch: note.pitch, more: `held ${ms(note.end - note.start)}` });
  }
  return found;
}

/** The list for one take. */
export function mistakeList(take, letter, seek) {
  const found = mistakes(take);
  const place = ({ secs, pitch, more }) => element('li', {}, element(
    'button', { type: 'button', on: { click: () => seek(secs) } },
    element('span', { class: 'when', text: clockText(secs) }), ` ${pitchName(pitch)}`, more && `, ${more}`,
  ));
  const rows = KINDS.map((kind) => [kind, found.filter((mistake) => mistake.kind === kind)]).filter(([, all]) => all.length > 0);
  return element(
    'div', { class: 'mistakes', role: 'group', 'aria-label': letter ? `Mistakes of take ${letter}` : 'Mistakes' },
    letter ? element('h3', { class: `take-${letter.toLowerCase()}`, text: letter }) : null,
    rows.length === 0 ? element('p', { text: 'No mistakes.' }) : null,
    ...rows.map(([kind, all]) => element(
      'div', { class: 'kind' }, element('span', { text: `${kind}: ${all.length}` }), element('ul', { 'aria-label': kind }, ...all.map(place)),
    )),
  );
}
