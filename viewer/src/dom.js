/** Creates elements. Text from recordings is always set as `textContent` and never as markup. */

/**
 * @param {string} tag
 * @param {Object<string, any>} [attributes] `class`, `text`, `on` (event handlers), anything else
 *   an attribute
 * @param {...(Node|string|null)} children
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === 'class') made.className = value;
    else if (name === 'text') made.textContent = value;
    else if (name === 'on') for (const [event, call] of Object.entries(value)) made.addEventListener(event, call);
    else made.setAttribute(name, value === true ? '' : value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

/**
 * A line for a phone above a table of so many columns, seen while the table is wider than the
 * element in which it scrolls.
 */
export function sidewaysHint(columns, scrolling) {
  const hint = element('p', { class: 'sideways', text: `${columns} columns: scroll the table sideways.`, hidden: true });
  new ResizeObserver(() => {
    hint.hidden = scrolling.scrollWidth <= scrolling.clientWidth;
  }).observe(scrolling);
  return hint;
}

/** Scrolls an element into view as little as it takes; at once if reduced motion is asked for. */
export function reveal(target) {
  const behavior = matchMedia('(prefers-reduced-motion: reduce)').matches ? 'auto' : 'smooth';
  target.scrollIntoView({ block: 'nearest', behavior });
}

/** Sets the text only if it differs, because every change costs a layout. */
export function setText(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** `m:ss.t` */
export function clockText(secs) {
  const tenths = Math.max(0, Math.floor(secs * 10 + 1e-6));
  const seconds = Math.floor(tenths / 10);
  return `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, '0')}.${tenths % 10}`;
}

const NAMES = ['C', 'C♯', 'D', 'D♯', 'E', 'F', 'F♯', 'G', 'G♯', 'A', 'A♯', 'B'];

/** MIDI pitch 60 is C4. */
export function pitchName(pitch) {
  return `${NAMES[pitch % 12]}${Math.floor(pitch / 12) - 1}`;
}

/** Whether a pitch is a black key. */
export function isBlack(pitch) {
  return NAMES[pitch % 12].length > 1;
}
