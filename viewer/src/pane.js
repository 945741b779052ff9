/** One 3D picture: a canvas, its renderer, its take and its resolution. */

import { LinearSRGBColorSpace, PerspectiveCamera, WebGLRenderer } from 'three';

import { element, reveal, setText } from './dom.js';
import { DRAWN_BY_PROCESSOR } from './quality.js';
import { Stage } from './stage.js';
import { backdrop } from './theme.js';

export class Pane {
  constructor(cameras, letter) {
    this.cameras = cameras;
    this.camera = new PerspectiveCamera();
    this.canvas = element('canvas', { class: 'scene', role: 'img' });
    this.caption = element('figcaption', {});
    this.remarks = element('ul', { class: 'remarks' });
    this.letter = letter;
    this.frame = element('div', { class: 'frame' }, this.canvas, this.remarks);
    this.root = element('figure', { class: 'pane' }, this.caption, this.frame);
    this.renderer = rendererOn(this.canvas);
    if (this.renderer) cameras.attach(this.canvas);
    else this.frame.prepend(element('p', { class: 'no-scene', text: 'This browser has no WebGL: the scene is not shown.' }));
    this.ratio = 1;
  }

  show(take, caption) {
    this.stage?.scene.background?.dispose();
    this.stage?.dispose();
    this.take = take;
    this.stage = new Stage(take);
    this.dress();
    this.live = element('span', { class: 'live' });
    this.canvas.setAttribute('aria-label', `The hand on the keyboard: ${take.song}, ${take.caption()}`);
    this.caption.replaceChildren(...caption, this.live);
    this.remarks.replaceChildren(...take.remarks.map((text) => element('li', { text })));
  }

  /** Fits the drawing to its place at `ratio` drawn pixels a CSS pixel. */
  resize(ratio) {
    const { clientWidth: width, clientHeight: height } = this.frame;
    if (width === 0 || height === 0 || (this.ratio === ratio && this.width === width && this.height === height)) return;
    Object.assign(this, { ratio, width, height });
    this.renderer?.setPixelRatio(ratio);
    this.renderer?.setSize(width, height, false);
    this.cameras.setAspect(width / height);
  }

  /** Applies the light or dark colours of the style sheet. */
  dress() {
    this.stage.scene.background?.dispose();
    this.stage.scene.background = backdrop();
  }

  draw(secs) {
    this.stage.pose(secs);
    this.renderer?.render(this.stage.scene, this.cameras.seenFrom(this.stage.lateral, this.camera));
  }

  /** Scrolls the scene into view if a part of it is out of sight, as on a phone. */
  reveal() {
    const { top, bottom } = this.frame.getBoundingClientRect();
    if (top < 0 || bottom > innerHeight) reveal(this.frame);
  }

  /** Moves the caption's number to a place. */
  mark(secs) {
    const f1 = this.take.running.f1?.[this.take.stepBefore(secs)];
    setText(this.live, Number.isFinite(f1) ? `so far ${f1.toFixed(3)}` : '');
  }
}

/** A renderer, or null if the browser has no WebGL; roll, numbers and sound work without. */
function rendererOn(canvas) {
  try {
    // Blending with the page and smoothing edges are slow without a graphics card.
    const renderer = new WebGLRenderer({ canvas, antialias: !DRAWN_BY_PROCESSOR, alpha: false, powerPreference: 'high-performance' });
    renderer.outputColorSpace = LinearSRGBColorSpace;
    return renderer;
  } catch {
    return null;
  }
}
