/** Names on the keys: the C of each octave, as players mark a keyboard that is new to them. */

import { CanvasTexture, Mesh, MeshBasicMaterial, PlaneGeometry } from 'three';

import { pitchName } from './dom.js';

/** Pixels of a name's picture. */
const PIXELS = [96, 64];
/** Distance of a name from the key's top, m: above the strip that shows when the key is due. */
const ABOVE = 0.0012;

/** A name near the front edge of a key, or null for a key that has none. */
export function keyLabel({ shape, pitch }) {
  if (!shape || pitch % 12 !== 0) return null;
  const [x, y, z] = shape.size;
  const height = 1.5 * y;
  const label = new Mesh(
    new PlaneGeometry((height * PIXELS[0]) / PIXELS[1], height),
    new MeshBasicMaterial({ map: picture(pitchName(pitch)), transparent: true, depthWrite: false }),
  );
  label.name = pitchName(pitch);
  label.position.copy(shape.position);
  label.position.x += x - 0.6 * height;
  label.position.z += z + ABOVE;
  // To be read by the player, who looks along -x.
  label.rotation.z = Math.PI / 2;
  return label;
}

export function disposeLabel(label) {
  label.material.map.dispose();
  label.material.dispose();
  label.geometry.dispose();
}

function picture(text) {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = PIXELS;
  const pen = canvas.getContext('2d');
  pen.font = '600 50px system-ui, sans-serif';
  pen.textAlign = 'center';
  pen.textBaseline = 'middle';
  pen.fillStyle = '#62656b';
  pen.fillText(text, PIXELS[0] / 2, PIXELS[1] / 2 + 3);
  return new CanvasTexture(canvas);
}
