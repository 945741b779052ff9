/** Numbers over time as small multiples: precision, recall and F1 so far, and each reward term. */

import { drawingOn, moveCursor } from './canvas.js';
import { element, setText } from './dom.js';
import { theme } from './theme.js';

const HEIGHT = 64;
const PAD = 4;
const DASHES = [[], [5, 3]];

class Plot {
  /**
   * @param {string} title
   * @param {{take: any, letter: string, values: number[]}[]} lines
   * @param {[number, number] | null} range null: what the values span, with zero
   */
  constructor(title, lines, range, seek) {
    this.lines = lines;
    this.range = range ?? spanOf(lines);
    this.canvas = element('canvas', {});
    this.cursor = element('div', { class: 'cursor' });
    this.values = lines.map((_, index) => element('output', { class: `take-${'ab'[index]}` }));
    this.area = element('div', { class: 'area' }, this.canvas, this.cursor);
    this.area.addEventListener('click', (event) => seek(event.offsetX / this.scale));
    this.root = element(
      'figure', { class: 'plot' },
      element('figcaption', {}, element('span', { text: title }), ...this.values),
      this.area,
    );
  }

  resize(duration) {
    const width = this.area.clientWidth;
    if (!width) return;
    this.scale = width / Math.max(duration, 1e-3);
    const pen = drawingOn(this.canvas, width, HEIGHT);
    const colours = theme();
    const [low, high] = this.range;
    const y = (value) => PAD + (HEIGHT - 2 * PAD) * (1 - (value - low) / (high - low));
    pen.fillStyle = colours.line;
    for (const value of new Set([low, Math.min(Math.max(0, low), high), high])) pen.fillRect(0, Math.round(y(value)), width, 1);
    this.lines.forEach(({ take, values }, index) => {
      pen.strokeStyle = colours.takes[index];
      pen.lineWidth = 1.5;
      pen.setLineDash(DASHES[index]);
      pen.beginPath();
      values.forEach((value, step) => {
        if (Number.isFinite(value)) pen.lineTo(((step + 1) / take.hz) * this.scale, y(value));
      });
      pen.stroke();
    });
  }

  moveTo(secs) {
    moveCursor(this.cursor, secs * this.scale);
    this.lines.forEach(({ take, letter, values }, index) => {
      const value = values[take.stepBefore(secs)];
      setText(this.values[index], `${letter} ${Number.isFinite(value) ? value.toFixed(3) : '–'}`.trim());
    });
  }
}

/** The range of the values with zero in it, never empty. */
function spanOf(lines) {
  let [low, high] = [0, 0];
  for (const { values } of lines) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return high > low ? [low, high] : [low, low + 1];
}

/** Whether each of the lines keeps one value. */
function areConstant(lines) {
  return lines.every(({ values }) => new Set(values.filter(Number.isFinite)).size <= 1);
}

/** The one value of each line; once, if it is the same. */
function constantText(lines) {
  const says = lines.map(({ letter, values }) => {
    const value = values.find(Number.isFinite);
    return { letter, value: value === undefined ? '–' : String(Number(value.toPrecision(3))) };
  });
  if (says.every(({ value }) => value === says[0].value)) return says[0].value;
  return says.map(({ letter, value }) => `${letter} ${value}`).join(' ');
}

const SCORES = [['f1', 'F1'], ['precision', 'precision'], ['recall', 'recall']];

export class Plots {
  /** @param {{take: any, letter: string}[]} shown one or two takes */
  constructor(shown, seek) {
    const lines = (pick) => shown.map(({ take, letter }) => ({ take, letter, values: pick(take) ?? [] }));
    const scores = SCORES.map(([name, title]) => new Plot(title, lines((take) => take.running[name]), [0, 1], seek));
    const terms = [...new Set(shown.flatMap(({ take }) => take.rewards.map((reward) => reward.name)))];
    const rewards = terms.map((name) => ({
      title: name.replaceAll('_', ' '), lines: lines((take) => take.rewards.find((reward) => reward.name === name)?.values),
    }));
    const constant = rewards.filter((reward) => areConstant(reward.lines));
    const drawn = rewards.filter((reward) => !constant.includes(reward));
    this.plots = [...scores, ...drawn.map((reward) => new Plot(reward.title, reward.lines, null, seek))];
    const notes = new Set(shown.map(({ take }) => take.rewardsNote).filter((note) => note !== null));
    if (rewards.length === 0) notes.add('The reward terms were not recorded.');
    const named = constant.map((reward) => `${reward.title} ${constantText(reward.lines)}`).join(', ');
    this.root = element(
      'section', { class: 'numbers' },
      element('h2', { text: 'Scores by control step so far, and the reward terms of each step' }),
      element('p', { class: 'note', text: 'F1, precision and recall compare the keys that sound with those that are due, control step by control step, as the paper does; the roll and the lists above judge strokes.' }),
      element('div', { class: 'plots' }, ...this.plots.map((plot) => plot.root)),
      named && element('p', { class: 'note', text: `Constant: ${named}.` }),
      ...[...notes].map((text) => element('p', { class: 'note', text })),
    );
  }

  resize(duration) {
    for (const plot of this.plots) plot.resize(duration);
  }

  moveTo(secs) {
    for (const plot of this.plots) plot.moveTo(secs);
  }
}
