/**
 * Soft shadows under the hand and its fingertips, which show their height above the keys, in one
 * draw call.
 */

import { CanvasTexture, InstancedMesh, Matrix4, MeshBasicMaterial, PlaneGeometry, Quaternion, Vector3 } from 'three';

/** Height of the shadows: slightly above the tops of the white keys, m. */
const FLOOR = 0.0228;
/** Size of a fingertip's shadow when it touches, m, and height at which it disappears, m. */
const TIP = { size: 0.045, gone: 0.055 };
/** Size of the hand's shadow, and its offset from the middle of the palm, m. */
const PALM = { depth: 0.13, width: 0.22, back: 0.09 };
/** Size of the keyboard's case, m. */
const GROUND = { depth: 0.62, width: 1.05, height: -0.001 };

export class Shadows extends InstancedMesh {
  constructor(hand, tips) {
    const material = new MeshBasicMaterial({ map: blot(), transparent: true, depthWrite: false, opacity: 0.5 });
    super(new PlaneGeometry(1, 1), material, tips.length + 2);
    this.frustumCulled = false;
    this.hand = hand;
    this.tips = tips;
    this.#put(0, 0, 0, GROUND.height, GROUND.depth, GROUND.width);
    this.#put(1, 0, 0, FLOOR, 0, 0);
  }

  update() {
    if (this.hand) {
      this.hand.getWorldPosition(at);
      this.#put(1, at.x - PALM.back, at.y, FLOOR, PALM.depth, PALM.width);
    }
    this.tips.forEach((tip, index) => {
      tip.getWorldPosition(at);
      const size = TIP.size * Math.max(0, 1 - (at.z - FLOOR) / TIP.gone);
      this.#put(index + 2, at.x, at.y, FLOOR + 0.0002, size, size);
    });
    this.instanceMatrix.needsUpdate = true;
  }

  #put(index, x, y, z, depth, width) {
    this.setMatrixAt(index, matrix.compose(place.set(x, y, z), FLAT, size.set(depth, width, 1)));
  }

  dispose() {
    super.dispose();
    this.geometry.dispose();
    this.material.map.dispose();
    this.material.dispose();
  }
}

const FLAT = new Quaternion();
const [at, place, size, matrix] = [new Vector3(), new Vector3(), new Vector3(), new Matrix4()];

function blot() {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 64;
  const context = canvas.getContext('2d');
  const fade = context.createRadialGradient(32, 32, 0, 32, 32, 32);
  fade.addColorStop(0, 'rgba(0,0,0,0.9)');
  fade.addColorStop(0.5, 'rgba(0,0,0,0.35)');
  fade.addColorStop(1, 'rgba(0,0,0,0)');
  context.fillStyle = fade;
  context.fillRect(0, 0, 64, 64);
  return new CanvasTexture(canvas);
}
