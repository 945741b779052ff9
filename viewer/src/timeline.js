/** The time line: the slider, and above it faults, warnings, clamps, and where two takes differ. */

import { drawingOn, hatching } from './canvas.js';
import { clockText, element } from './dom.js';
import { FAULT, WARNING, theme } from './theme.js';

/** Colour, shape and name of each kind of mark. */
const KINDS = {
  fault: { colour: FAULT, shape: 'triangle', one: 'fault', many: 'faults' },
  warning: { colour: WARNING, shape: 'diamond', one: 'warning', many: 'warnings' },
  clamp: { colour: '#808080', shape: 'tick', one: 'stretch of limited set-points', many: 'stretches of limited set-points' },
  phase: { colour: '#009E73', shape: 'flag', one: 'phase', many: 'phases' },
  difference: { colour: '#808080', shape: 'band', one: 'place where A and B sound different keys', many: 'places where A and B sound different keys' },
};
const LANE = 14;
/** Least distance of two bar lines, pixels. */
const BARS_APART = 6;
/** Width of a mark in the legend. */
const SWATCH = 16;
/** Longest list; a recording that clamps at every step has thousands of marks. */
const MAX_LISTED = 200;
/** Distance from the pointer within which a mark shows its tooltip, pixels. */
const NEAR = 6;

export class Timeline {
  constructor(player) {
    this.player = player;
    this.strip = element('canvas', { class: 'strip', 'aria-hidden': 'true' });
    this.slider = element('input', { type: 'range', min: '0', step: 'any', class: 'place', 'aria-label': 'Place in the song' });
    this.slider.addEventListener('input', () => player.seek(Number(this.slider.value)));
    this.strip.addEventListener('click', (event) => player.seek(this.#near(event)?.secs ?? event.offsetX / this.scale));
    this.strip.addEventListener('pointermove', (event) => {
      this.strip.title = this.#near(event)?.text ?? '';
    });
    this.summary = element('summary', {});
    this.list = element('ol', {});
    this.details = element('details', { class: 'marks' }, this.summary, this.list);
    this.root = element('div', { class: 'timeline' }, this.strip, this.slider);
  }

  /**
   * @param {{take: any, letter: string}[]} shown
   * @param {[number, number][]} differences
   */
  show(shown, differences) {
    const label = (letter) => (letter ? `${letter}: ` : '');
    this.lanes = shown.map(({ take }) => take.marks);
    this.differences = differences;
    this.bars = shown[0].take.bars;
    this.marks = [
      ...shown.flatMap(({ take, letter }, lane) =>
        take.marks.map((mark) => ({ ...mark, lane, text: `${label(letter)}${mark.kind}: ${mark.text}` }))),
      ...differences.map(([from, to]) => ({ secs: from, kind: 'difference', lane: -1, text: differenceText(from, to) })),
    ].sort((a, b) => a.secs - b.secs);
    this.slider.max = String(this.player.duration);
    this.#listMarks();
  }

  #listMarks() {
    const found = Object.entries(KINDS).flatMap(([kind, { one, many }]) => {
      const count = this.marks.filter((mark) => mark.kind === kind).length;
      return count === 0 ? [] : [[kind, `${count} ${count === 1 ? one : many}`]];
    });
    this.swatches = found.map(([kind]) => ({ kind, canvas: element('canvas', { 'aria-hidden': 'true' }) }));
    const legend = found.map(([, text], index) => element('span', { class: 'item' }, this.swatches[index].canvas, text));
    this.summary.replaceChildren('On the time line: ', element('span', { class: 'legend' }, ...legend));
    this.details.hidden = this.marks.length === 0;
    const rows = this.marks.slice(0, MAX_LISTED).map((mark) => {
      const go = element('button', { type: 'button', on: { click: () => this.player.seek(mark.secs) } },
        element('span', { class: 'when', text: clockText(mark.secs) }), ` ${mark.text}`);
      return element('li', { class: `mark ${mark.kind in KINDS ? mark.kind : ''}` }, go);
    });
    const left = this.marks.length - MAX_LISTED;
    if (left > 0) rows.push(element('li', { text: `and ${left} more, on the time line above` }));
    this.list.replaceChildren(...rows);
  }

  resize() {
    const width = this.strip.parentElement.clientWidth;
    if (!width) return;
    this.scale = width / Math.max(this.player.duration, 1e-3);
    const height = LANE * this.lanes.length;
    const pen = drawingOn(this.strip, width, height);
    const colours = theme();
    pen.fillStyle = colours.shade;
    pen.fillRect(0, 0, width, height);
    pen.fillStyle = colours.line;
    let free = -Infinity;
    for (const x of this.bars.map((secs) => Math.round(secs * this.scale))) {
      if (x < free) continue;
      pen.fillRect(x, 0, 1, height);
      free = x + BARS_APART;
    }
    const { loop } = this.player;
    if (loop) {
      pen.fillStyle = colours.faint;
      pen.fillRect(loop.from * this.scale, 0, (loop.to - loop.from) * this.scale, height);
      pen.fillStyle = colours.ink;
      for (const secs of [loop.from, loop.to]) pen.fillRect(Math.round(secs * this.scale) - 1, 0, 2, height);
    }
    for (const [from, to] of this.differences) drawBand(pen, from * this.scale, Math.max((to - from) * this.scale, 2), height);
    this.lanes.forEach((marks, lane) => {
      for (const mark of marks) drawMark(pen, KINDS[mark.kind] ?? KINDS.warning, mark.secs * this.scale, lane * LANE, colours.paper);
    });
    for (const { kind, canvas } of this.swatches) {
      const swatch = drawingOn(canvas, SWATCH, LANE);
      if (kind === 'difference') drawBand(swatch, 0, SWATCH, LANE);
      else drawMark(swatch, KINDS[kind], SWATCH / 2, 0, colours.paper);
    }
  }

  moveTo(secs) {
    this.slider.value = String(secs);
    const bar = this.bars.findLastIndex((start) => start <= secs + 1e-6) + 1;
    const says = `${clockText(secs)}${bar > 0 ? `, bar ${bar}` : ''}`;
    if (this.slider.getAttribute('aria-valuetext') !== says) this.slider.setAttribute('aria-valuetext', says);
  }

  #near(event) {
    const lane = Math.floor(event.offsetY / LANE);
    const off = (mark) => Math.abs(mark.secs * this.scale - event.offsetX);
    const near = this.marks.filter((mark) => (mark.lane === lane || mark.lane < 0) && off(mark) <= NEAR);
    return near.sort((a, b) => off(a) - off(b))[0];
  }
}

function differenceText(from, to) {
  return `A and B sound different keys for ${(to - from).toFixed(2)} s`;
}

/** A hatched stretch: where two takes sound different keys. */
function drawBand(pen, x, width, height) {
  const { colour } = KINDS.difference;
  pen.fillStyle = hatching(pen, colour, 4);
  pen.fillRect(x, 0, width, height);
  pen.fillStyle = colour;
  pen.fillRect(x, 0, 1, height);
  pen.fillRect(x + width - 1, 0, 1, height);
}

function drawMark(pen, { colour, shape }, x, top, paper) {
  const middle = top + LANE / 2;
  const outlines = {
    triangle: [[0, -6], [6, 5], [-6, 5]],
    diamond: [[0, -6], [5, 0], [0, 6], [-5, 0]],
    flag: [[-1, -6], [7, -3], [1, 0], [1, 6], [-1, 6]],
    tick: [[-1, -4], [1, -4], [1, 4], [-1, 4]],
  };
  pen.beginPath();
  for (const [dx, dy] of outlines[shape]) pen.lineTo(x + dx, middle + dy);
  pen.closePath();
  pen.fillStyle = colour;
  pen.fill();
  if (shape === 'tick') return;
  pen.strokeStyle = paper;
  pen.lineWidth = 1;
  pen.stroke();
}
