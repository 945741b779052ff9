/** Note by note: the mistakes of each take, and every due note with how each take played it. A click goes to its place. */

import { clockText, element, pitchName, sidewaysHint } from './dom.js';
import { mistakeList } from './mistakes.js';

const signed = (secs) => `${secs < -0.0005 ? '−' : '+'}${Math.abs(secs * 1000).toFixed(0)}`;

/** What a listener hears of a take, in a few words; null without notes that were due. */
export function summary(take) {
  const { noteScores: scores } = take;
  if (!scores) return null;
  return `${scores.matched} of ${scores.matched + scores.missed} notes right, ${scores.wrong} wrong`;
}

/**
 * @param {{take: any, letter: string}[]} shown one or two takes of the same notes
 * @param {(secs: number, index?: number) => void} seek `index`: of which take
 * @returns {HTMLElement | null} null if no take has notes that were due, or if two are of different notes
 */
export function noteTable(shown, seek) {
  const [{ take: first }] = shown;
  const pitches = (take) => take.dueNotes.map((note) => note.pitch).join();
  if (first.dueNotes.length === 0 || shown.some(({ take }) => pitches(take) !== pitches(first))) return null;
  const place = (secs, name) => element('button', { text: clockText(secs), 'aria-label': `${name} at ${clockText(secs)}`, on: { click: () => seek(secs) } });
  const heads = (names) => names.map((text) => element('th', { scope: 'col', text }));
  const rows = first.dueNotes.map((due, index) => element(
    'tr', {},
    element('td', {}, place(due.start, pitchName(due.pitch))),
    element('th', { scope: 'row', text: pitchName(due.pitch) }),
    ...shown.flatMap(({ take }) => cells(take, index)),
  ));
  const letters = shown.length > 1 && element(
    'tr', {},
    element('td', { colspan: 2 }),
    ...shown.map(({ letter }, index) => element('th', { scope: 'colgroup', colspan: 3, class: `take-${'ab'[index]}`, text: letter })),
  );
  const scrolling = element(
    'div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Notes' },
    element(
      'table', {},
      element('thead', {}, letters || null, element('tr', {}, ...heads(['due', 'note']), ...shown.flatMap(() => heads(['onset', 'length', 'velocity'])))),
      element('tbody', {}, ...rows),
    ),
  );
  return element(
    'section', { class: 'notes' },
    element('h2', { text: 'Mistakes' }),
    ...shown.map(({ take, letter }, index) => mistakeList(take, letter, (secs) => seek(secs, index))),
    element('h2', { text: 'Note by note' }),
    element('p', { class: 'note', text: 'Onset and length: played minus due, in ms; late and long are positive. In the scores a note more than 50 ms early or late counts as missed, and its stroke as wrong. Velocity: MIDI; a stroke more than 40 above or below the written velocity is too loud or too soft.' }),
    sidewaysHint(2 + 3 * shown.length, scrolling),
    scrolling,
  );
}

function cells(take, index) {
  const heard = take.heard[index];
  const note = heard && take.notes[heard.note];
  if (!note) return [element('td', { class: 'missed', colspan: 3, text: 'missed' })];
  const due = take.dueNotes[index];
  const error = note.start - due.start;
  const late = error > 0 ? 'late' : 'early';
  return [
    element('td', { class: heard.right ? null : 'off', text: heard.right ? signed(error) : `${signed(error)}, too ${late}` }),
    element('td', { text: signed(note.end - note.start - (due.end - due.start)) }),
    element('td', { text: String(note.velocity) }),
  ];
}
