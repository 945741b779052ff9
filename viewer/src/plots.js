/** Numbers over time as small multiples: precision, recall and F1 so far, and each reward term. */

import { drawingOn, moveCursor } from './canvas.js';
import { columnsOf } from './columns.js';
import { element, setText } from './dom.js';
import { theme } from './theme.js';

const HEIGHT = 64;
const PAD = 4;
/** Width of the margin with the range, pixels. */
const MARGIN = 48;
const DASHES = [[], [5, 3]];
/**
 * With more control steps in a pixel than this, a line through all of them would fill the chart.
 */
const CROWDED = 6;
const BAND_ALPHA = 0.25;

class Plot {
  /**
   * @param {{title: string, lines: {take: any, letter: string, values: number[]}[], range: [number,
   *   number]}} curve
   */
  constructor({ title, lines, range }, seek) {
    Object.assign(this, { lines, range });
    this.canvas = element('canvas', {});
    this.cursor = element('div', { class: 'cursor' });
    this.values = lines.map((_, index) => element('output', { class: `take-${'ab'[index]}` }));
    this.area = element('div', { class: 'area' }, this.canvas, this.cursor);
    this.area.addEventListener('click', (event) => seek(Math.max(0, event.offsetX - MARGIN) / this.scale));
    this.root = element(
      'figure', { class: 'plot' },
      element('figcaption', {}, element('span', { text: title }), ...this.values),
      this.area,
    );
  }

  resize(duration) {
    const width = this.area.clientWidth;
    if (!width) return;
    this.scale = (width - MARGIN) / Math.max(duration, 1e-3);
    const pen = drawingOn(this.canvas, width, HEIGHT);
    const colours = theme();
    const [low, high] = this.range;
    const y = (value) => PAD + (HEIGHT - 2 * PAD) * (1 - (value - low) / (high - low));
    pen.fillStyle = colours.line;
    for (const value of new Set([low, Math.min(Math.max(0, low), high), high])) pen.fillRect(MARGIN, Math.round(y(value)), width, 1);
    this.lines.forEach(({ take, values }, index) => {
      const x = (step) => MARGIN + take.endOf(step) * this.scale;
      pen.strokeStyle = pen.fillStyle = colours.takes[index];
      pen.lineWidth = 1.5;
      pen.setLineDash(DASHES[index]);
      pen.beginPath();
      if (this.isCrowded(take)) {
        const columns = columnsOf(values, (step) => Math.floor(x(step - 1)));
        pen.globalAlpha = BAND_ALPHA;
        for (const { column, low, high } of columns) pen.fillRect(column, y(high), 1, y(low) - y(high));
        pen.globalAlpha = 1;
        for (const { column, mean } of columns) pen.lineTo(column + 0.5, y(mean));
      } else {
        values.forEach((value, step) => {
          if (Number.isFinite(value)) pen.lineTo(x(step), y(value));
        });
      }
      pen.stroke();
    });
    pen.fillStyle = colours.quiet;
    pen.font = '10px system-ui, sans-serif';
    pen.textAlign = 'right';
    pen.textBaseline = 'middle';
    for (const [value, inwards] of [[high, 5], [low, -5]]) pen.fillText(shortText(value, 2), MARGIN - 4, y(value) + inwards);
  }

  /**
   * Whether the line of a take is the mean of each pixel column, on a band from the lowest to the
   * highest value.
   */
  isCrowded(take) {
    return take.hz > CROWDED * this.scale;
  }

  moveTo(secs) {
    moveCursor(this.cursor, MARGIN + secs * this.scale);
    this.lines.forEach(({ take, letter, values }, index) => {
      const value = values[take.stepBefore(secs)];
      setText(this.values[index], `${letter} ${Number.isFinite(value) ? fixedText(value) : '–'}`.trim());
    });
  }
}

const finite = (lines) => lines.flatMap(({ values }) => values.filter(Number.isFinite));
const least = (values) => values.reduce((low, value) => Math.min(low, value), Infinity);
const most = (values) => values.reduce((high, value) => Math.max(high, value), -Infinity);

/** The range of the values with zero in it. */
function spanOf(lines) {
  const values = [0, ...finite(lines)];
  return [least(values), most(values)];
}

/**
 * From a hundredth below the lowest score to 1, so that a score that is nearly perfect is no flat
 * line.
 */
function scoreSpanOf(lines) {
  return [Math.floor(100 * least(finite(lines))) / 100, 1];
}

/** Whether each of the lines keeps one value. */
function areConstant(lines) {
  return lines.every(({ values }) => new Set(values.filter(Number.isFinite)).size <= 1);
}

/** The one value of each line; once, if it is the same. */
function constantText(lines) {
  const says = lines.map(({ letter, values }) => {
    const value = values.find(Number.isFinite);
    return { letter, value: value === undefined ? '–' : shortText(value) };
  });
  if (says.every(({ value }) => value === says[0].value)) return says[0].value;
  return says.map(({ letter, value }) => `${letter} ${value}`).join(' ');
}

/** A number with at most so many significant digits. */
const shortText = (value, digits = 3) => String(Number(value.toPrecision(digits))).replace('-', '−');

/** A number with three digits after the point; one that rounds to zero has no sign. */
const fixedText = (value) => value.toFixed(3).replace(/^-(?=0\.000$)/, '').replace('-', '−');

const SCORES = [['f1', 'F1'], ['precision', 'precision'], ['recall', 'recall']];

export class Plots {
  /** @param {{take: any, letter: string}[]} shown one or two takes */
  constructor(shown, seek) {
    const lines = (pick) => shown.map(({ take, letter }) => ({ take, letter, values: pick(take) ?? [] }));
    const scores = SCORES.map(([name, title]) => ({ title, lines: lines((take) => take.running[name]), spanOf: scoreSpanOf }));
    const terms = [...new Set(shown.flatMap(({ take }) => take.rewards.map((reward) => reward.name)))];
    const rewards = terms.map((name) => ({
      title: name.replaceAll('_', ' '), lines: lines((take) => take.rewards.find((reward) => reward.name === name)?.values), spanOf,
    }));
    const curves = [...scores, ...rewards].filter((curve) => finite(curve.lines).length > 0);
    const constant = curves.filter((curve) => areConstant(curve.lines));
    const drawn = curves.filter((curve) => !constant.includes(curve));
    this.plots = drawn.map((curve) => new Plot({ ...curve, range: curve.spanOf(curve.lines) }, seek));
    const said = new Set(shown.map(({ take }) => take.rewardsNote).filter((note) => note !== null));
    const notes = [...said].map((note) => {
      const letters = shown.filter(({ take }) => take.rewardsNote === note).map(({ letter }) => letter).join(' and ');
      return letters ? `${letters}: ${note}` : note;
    });
    if (rewards.length === 0) notes.push('The reward terms were not recorded.');
    const named = constant.map((curve) => `${curve.title} ${constantText(curve.lines)}`).join(', ');
    this.crowded = element('p', { class: 'note', text: 'One pixel of a chart is several control steps: the line is their mean, the pale band their range.', hidden: true });
    this.root = element(
      'section', { class: 'numbers' },
      element('h2', { text: 'Scores by control step so far, and the reward terms of each step' }),
      element('p', { class: 'note', text: 'F1, precision and recall compare the keys that sound with those that are due, control step by control step, as the paper does; the roll and the lists above judge strokes.' }),
      this.crowded,
      element('div', { class: 'plots' }, ...this.plots.map((plot) => plot.root)),
      named ? element('p', { class: 'note', text: `Not drawn, because constant: ${named}.` }) : null,
      ...notes.map((text) => element('p', { class: 'note', text })),
    );
  }

  resize(duration) {
    for (const plot of this.plots) plot.resize(duration);
    this.crowded.hidden = !this.plots.some((plot) => plot.lines.some(({ take }) => plot.isCrowded(take)));
  }

  moveTo(secs) {
    for (const plot of this.plots) plot.moveTo(secs);
  }
}
