/** Cameras: four views, which can be rotated and zoomed. */

import { PerspectiveCamera, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

/**
 * The views. `direction` points from the target to the camera, `width` × `height` (m) is the
 * visible area at the target, `follows` moves the view along the keyboard with the hand. `etude
 * render` has the same (crates/stage/src/picture.rs).
 */
export const VIEWS = [
  { name: 'player', label: 'Player', target: [0.03, 0, 0.03], direction: [0.66, -0.09, 0.85], width: 0.76, height: 0.33, follows: false },
  { name: 'side', label: 'Side', target: [0.03, 0, 0.06], direction: [0.1, -1, 0.24], width: 0.34, height: 0.26, follows: true },
  { name: 'top', label: 'Top', target: [0.03, 0, 0.03], direction: [0.02, 0, 1], width: 0.76, height: 0.42, follows: false },
  { name: 'fingers', label: 'Fingers', target: [0.03, 0, 0.055], direction: [0.45, -0.8, 0.3], width: 0.3, height: 0.19, follows: true },
];

const FIELD_OF_VIEW_DEG = 30;

/** One camera for all panes, so that two takes are seen from the same place. */
export class Cameras {
  /** @param {() => void} changed called when the view has moved */
  constructor(changed) {
    this.changed = changed;
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.02, 5);
    this.camera.up.set(0, 0, 1);
    this.target = new Vector3();
    this.controls = new Map();
    this.aspect = 1;
    this.moved = false;
    this.choose('fingers');
  }

  choose(name) {
    this.view = VIEWS.find((view) => view.name === name) ?? this.view;
    this.moved = false;
    this.#aim();
  }

  /** Fits a view to the shape of the pane, until the user has moved it. */
  setAspect(aspect) {
    this.aspect = aspect;
    if (!this.moved) this.#aim();
  }

  #aim() {
    const { target, direction, width, height } = this.view;
    const tangent = Math.tan((FIELD_OF_VIEW_DEG / 2) * (Math.PI / 180));
    const distance = Math.max(height / (2 * tangent), width / (2 * tangent * this.aspect));
    this.target.set(...target);
    this.camera.position.set(...direction).setLength(distance).add(this.target);
    for (const controls of this.controls.values()) controls.update();
    this.camera.lookAt(this.target);
    this.changed();
  }

  /** Handles rotation and zoom on a canvas. */
  attach(canvas) {
    // The wheel scrolls the page; with Ctrl (or by a pinch on a trackpad, which sends the same
    // event) it zooms.
    const wheel = (event) => event.ctrlKey || event.metaKey || event.stopImmediatePropagation();
    canvas.addEventListener('wheel', wheel, { capture: true });
    const controls = new OrbitControls(this.camera, canvas);
    controls.target = this.target;
    controls.enablePan = false;
    controls.minDistance = 0.1;
    controls.maxDistance = 3;
    controls.maxPolarAngle = Math.PI * 0.49;
    // One finger scrolls the page vertically and rotates the scene horizontally; two fingers zoom.
    canvas.style.touchAction = 'pan-y';
    controls.addEventListener('start', () => {
      this.moved = true;
    });
    controls.addEventListener('change', this.changed);
    this.controls.set(canvas, controls);
  }

  /** The camera for one pane, whose hand is `lateral` m off the keyboard's middle. */
  seenFrom(lateral, pane) {
    pane.copy(this.camera);
    if (this.view.follows) pane.position.y += lateral;
    pane.aspect = this.aspect;
    pane.updateProjectionMatrix();
    return pane;
  }
}
