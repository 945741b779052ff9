/** Elements that several sections share. */

import { element, sidewaysHint } from '../dom.js';

/** A button; it keeps the focus by its `key` when its section is rebuilt. */
export function button(text, key, press, attributes = {}) {
  return element('button', { type: 'button', text, 'data-key': key, on: { click: press }, ...attributes });
}

/** A field with its label. */
export function field(text, control) {
  return element('label', { class: 'field' }, element('span', { text }), control);
}

/** A choice of `[value, text]`. */
export function choice(options, attributes = {}) {
  return element('select', attributes, ...options.map(([value, text]) => element('option', { value, text })));
}

/** A table that scrolls in its own element. Cells are texts or elements. */
export function table(caption, columns, rows) {
  const scrolling = element(
    'div', { class: 'scroll down', role: 'group', 'aria-label': caption, tabindex: '0' },
    element(
      'table', {},
      element('thead', {}, element('tr', {}, ...columns.map((text) => element('th', { scope: 'col', text })))),
      element('tbody', {}, ...rows.map((cells) => element('tr', {}, ...cells.map((cell) => element('td', {}, cell))))),
    ),
  );
  return element('div', {}, sidewaysHint(columns.length, scrolling), scrolling);
}

/** A section with a heading, whose content is rebuilt only when its data has changed. */
export class Section {
  constructor(title) {
    this.content = element('div', {});
    this.heading = element('h2', { text: title });
    this.root = element('section', {}, this.heading, this.content);
  }

  /** `make` builds the content for `data`; `null` hides the section. */
  show(data, make) {
    const text = JSON.stringify(data);
    if (text === this.shown) return;
    this.shown = text;
    const key = this.content.contains(document.activeElement) ? document.activeElement.dataset.key : undefined;
    const made = make();
    this.root.hidden = made === null;
    this.content.replaceChildren(...(made ?? []).filter((part) => part !== null));
    if (key !== undefined) this.content.querySelector(`[data-key="${CSS.escape(key)}"]`)?.focus();
  }
}

/** `12 of 14 notes right, 1 wrong` */
export function notesText({ notes_right: right, notes_due: due, notes_wrong: wrong }) {
  return due === null || due === undefined ? '' : `${right} of ${due} notes right, ${wrong} wrong`;
}

/** `F1 0.981` */
export function scoreText(f1) {
  return typeof f1 === 'number' ? `F1 ${f1.toFixed(3)}` : '';
}

/** A duration as `m:ss`, or hours and minutes. */
export function timeText(secs) {
  const whole = Math.round(secs);
  const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, String(whole % 60).padStart(2, '0')];
  return hours > 0 ? `${hours} h ${String(minutes).padStart(2, '0')} min` : `${minutes}:${rest}`;
}

/** The player; of a policy the file and the folder of its run. */
export function playerText(player) {
  return player === 'scripted' ? 'the scripted baseline' : `the policy ${player.split('/').slice(-2).join('/')}`;
}
