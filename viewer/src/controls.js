/** Buttons, shortcuts and the help that lists them. */

import { VIEWS } from './cameras.js';
import { clockText, element, setText } from './dom.js';

const ICONS = {
  play: 'M7 4 L20 12 L7 20 Z',
  pause: 'M6 4 H10.5 V20 H6 Z M13.5 4 H18 V20 H13.5 Z',
  sound: 'M4 9 V15 H8 L13 20 V4 L8 9 Z M15.5 8.5 A5 5 0 0 1 15.5 15.5 M18 6 A8.5 8.5 0 0 1 18 18',
  muted: 'M4 9 V15 H8 L13 20 V4 L8 9 Z M16 9 L22 15 M22 9 L16 15',
};

const SHORTCUTS = [
  ['Space', 'play or pause'],
  ['← →', 'one control step back or on'],
  ['Shift ← →', 'one second back or forward'],
  ['Home End', 'to the beginning or the end'],
  ['1 2 3 4', VIEWS.map((view) => view.label.toLowerCase()).join(', ')],
  ['H', 'half speed'],
  ['L', 'loop the bar'],
  ['M', 'sound off or on'],
  ['R', 'the song as written, or as it was played'],
  ['?', 'this list'],
];

/** An icon; `currentColor` lets the style sheet colour it. */
export function icon(name) {
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('viewBox', '0 0 24 24');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS('http://www.w3.org/2000/svg', 'path');
  path.setAttribute('d', ICONS[name]);
  svg.append(path);
  return svg;
}

/** A button. After a click it loses the focus, so that Space still plays and pauses. */
function button(label, title, click, content = label) {
  const made = element('button', { type: 'button', title, 'aria-label': label }, content);
  made.addEventListener('click', (event) => {
    if (event.detail > 0) made.blur();
    click();
  });
  return made;
}

function press(target, pressed) {
  target.setAttribute('aria-pressed', String(pressed));
}

/**
 * @typedef {object} Actions what the controls can do
 * @property {() => void} togglePlay
 * @property {() => void} toggleHalf
 * @property {() => void} toggleLoop
 * @property {() => void} toggleMute
 * @property {(volume: number) => void} setVolume
 * @property {(name: string) => void} setCamera
 * @property {(steps: number) => void} stepBy
 * @property {(secs: number) => void} seek
 * @property {(pane: number) => void} listenTo
 * @property {() => void} toggleWritten
 */
export class Controls {
  /** @param {Actions} actions */
  constructor(actions, player, letters) {
    this.actions = actions;
    this.player = player;
    this.play = button('Play', 'Play or pause (Space)', actions.togglePlay, icon('play'));
    this.play.classList.add('play');
    this.time = element('span', { class: 'time' });
    this.half = button('½ speed', 'Half speed (H)', actions.toggleHalf);
    this.loop = button('Loop bar', 'Loop this bar (L)', actions.toggleLoop);
    this.cameras = VIEWS.map(({ name, label }, index) =>
      button(label, `Camera: ${label.toLowerCase()} (${index + 1})`, () => actions.setCamera(name)));
    this.mute = button('Mute', 'Sound off or on (M)', actions.toggleMute, icon('sound'));
    const slide = () => actions.setVolume(Number(this.volume.value));
    this.volume = element('input', { type: 'range', min: '0', max: '1', step: '0.05', value: '0.8', class: 'volume', 'aria-label': 'Volume', on: { input: slide } });
    this.sources = letters.map((letter, pane) => button(`Hear take ${letter}`, `Hear take ${letter}`, () => actions.listenTo(pane), letter));
    this.written = button('As written', 'The song as written, or as it was played (R)', actions.toggleWritten);
    this.dialog = helpDialog();
    const help = button('Help', 'Keyboard shortcuts (?)', () => this.dialog.showModal(), '?');
    const group = (label, ...buttons) => element('div', { class: 'group', role: 'group', 'aria-label': label }, ...buttons);
    this.root = element(
      'div', { class: 'controls' },
      group('Playing', this.play, this.time),
      group('How it is played', this.half, this.loop),
      group('Camera', ...this.cameras),
      group('Sound', this.mute, this.volume, ...this.sources, this.written, help),
      this.dialog,
    );
    addEventListener('keydown', (event) => this.#shortcut(event));
  }

  /** Shows the current state. */
  update({ muted, camera, audible, written, writable }) {
    const { playing, speed, loop } = this.player;
    const does = playing ? 'Pause' : 'Play';
    this.play.replaceChildren(icon(does.toLowerCase()), does);
    this.play.setAttribute('aria-label', does);
    press(this.half, speed !== 1);
    press(this.loop, loop !== null);
    press(this.mute, muted);
    this.mute.replaceChildren(icon(muted ? 'muted' : 'sound'));
    VIEWS.forEach(({ name }, index) => press(this.cameras[index], name === camera));
    this.sources.forEach((source, pane) => press(source, pane === audible && !written));
    press(this.written, written);
    this.written.hidden = !writable;
  }

  moveTo(secs) {
    setText(this.time, `${clockText(secs)} / ${clockText(this.player.duration)}`);
  }

  #shortcut(event) {
    const { actions, player } = this;
    if (event.ctrlKey || event.metaKey || event.altKey || this.dialog.open) return;
    // A focused control handles its own keys.
    if (event.target.closest?.('select, input.volume')) return;
    // A held key repeats steps, but not switches.
    if (event.repeat && !event.key.startsWith('Arrow')) return;
    if (event.key === ' ' && event.target.closest?.('button, summary')) return;
    const arrow = (sign) => (event.shiftKey ? actions.seek(player.time() + sign) : actions.stepBy(sign));
    const keys = {
      ' ': actions.togglePlay,
      ArrowLeft: () => arrow(-1),
      ArrowRight: () => arrow(1),
      Home: () => actions.seek(0),
      End: () => actions.seek(player.duration),
      h: actions.toggleHalf,
      l: actions.toggleLoop,
      m: actions.toggleMute,
      r: actions.toggleWritten,
      '?': () => this.dialog.showModal(),
    };
    VIEWS.forEach(({ name }, index) => {
      keys[index + 1] = () => actions.setCamera(name);
    });
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}

function helpDialog() {
  const rows = SHORTCUTS.map(([keys, does]) =>
    element('tr', {}, element('th', { scope: 'row' }, ...keys.split(' ').map((key) => element('kbd', { text: key }))), element('td', { text: does })));
  const close = element('button', { type: 'submit', text: 'Close' });
  return element(
    'dialog', { 'aria-label': 'Keyboard shortcuts' },
    element('h2', { text: 'Keyboard shortcuts' }),
    element('table', {}, element('tbody', {}, ...rows)),
    element('p', { text: 'Drag the scene to rotate it; pinch, or use the wheel with Ctrl, to zoom. Choosing a camera resets it.' }),
    element('form', { method: 'dialog' }, close),
  );
}
