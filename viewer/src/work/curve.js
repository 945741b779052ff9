/** A curve of a training as a drawing. */

import { element } from '../dom.js';

const [WIDTH, HEIGHT] = [320, 110];
/** Room for the numbers at the axes. */
const [LEFT, BOTTOM, TOP, RIGHT] = [50, 18, 8, 8];

function drawn(tag, attributes, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** Control steps, short. */
export function stepsText(steps) {
  if (steps >= 1e6) return `${Number((steps / 1e6).toPrecision(3))} M`;
  return steps >= 1e4 ? `${Math.round(steps / 1e3)} k` : String(Math.round(steps));
}

/**
 * @param {string} title
 * @param {[number, number][]} points control steps and value
 * @param {[number, number] | null} range null: what the values span
 */
export function curve(title, points, range, totalSteps) {
  const values = points.map(([, value]) => value);
  let [low, high] = range ?? [Math.min(...values), Math.max(...values)];
  // Without a value, or with one alone, there is no range.
  if (!Number.isFinite(low)) [low, high] = [0, 1];
  if (high === low) [low, high] = [low - 0.5, low + 0.5];
  const most = Math.max(totalSteps ?? 0, points.at(-1)?.[0] ?? 0, 1);
  const x = (step) => LEFT + (WIDTH - LEFT - RIGHT) * (step / most);
  const y = (value) => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low));
  const last = values.at(-1);
  const numberText = (text) => text.replace('-', '−');
  const said = last === undefined ? 'nothing yet' : numberText(last.toFixed(3));
  const line = (value) => drawn('line', { class: 'axis', x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value) });
  const label = (value) => drawn('text', { x: LEFT - 5, y: y(value) + 4, 'text-anchor': 'end' }, numberText(String(Number(value.toPrecision(2)))));
  const drawing = drawn(
    'svg', { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: 'img', 'aria-label': `${title} over control steps; the last value is ${said}` },
    line(low), line(high), label(low), label(high),
    drawn('text', { x: LEFT, y: HEIGHT - 3 }, '0'),
    drawn('text', { x: WIDTH - RIGHT, y: HEIGHT - 3, 'text-anchor': 'end' }, `${stepsText(most)} control steps`),
    drawn('polyline', { points: points.map(([step, value]) => `${x(step).toFixed(1)},${y(value).toFixed(1)}`).join(' ') }),
    ...(last === undefined ? [] : [drawn('circle', { cx: x(points.at(-1)[0]), cy: y(last), r: 2.5 })]),
  );
  return element('figure', { class: 'curve' }, element('figcaption', {}, title, ' ', element('strong', { text: said })), drawing);
}
