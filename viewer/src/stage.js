/** The keyboard and the hand of one take as three.js objects, and their pose at a time. */

import { Color, DirectionalLight, Group, HemisphereLight, Scene } from 'three';

import { Arm } from './arm.js';
import { bodyTree } from './bodies.js';
import { keyKind } from './classify.js';
import { disposeLabel, keyLabel } from './labels.js';
import { Shadows } from './shadows.js';
import { Shape, Solids } from './shapes.js';
import { DUE, MISSED, OFF, RIGHT, WRONG } from './theme.js';

const LOWEST_PITCH = 36;
const PAINT = { right: new Color(RIGHT), off: new Color(OFF), missed: new Color(MISSED), wrong: new Color(WRONG) };

export class Stage {
  constructor(take) {
    this.take = take;
    this.scene = new Scene();
    this.world = new Group();
    this.scene.add(this.world, ...lights());
    this.bodies = bodyTree(take.scene.bodies, this.world);
    const shapes = take.scene.geoms.map((geom) => {
      const shape = new Shape(geom);
      (this.bodies[geom.body] ?? this.world).add(shape);
      return shape;
    });
    this.driven = this.bodies.filter((body) => body.joint?.drive !== undefined);
    this.keys = this.bodies.filter((body) => body.joint?.key !== undefined).map(keyOf);
    this.labels = this.keys.map(labelled).filter((label) => label !== null);
    shapes.push(...this.keys.map((key) => key.strip).filter((strip) => strip !== null));
    this.arm = take.arm ? new Arm(take) : null;
    if (this.arm) {
      this.world.add(...this.arm.tubes);
      shapes.push(...this.arm.tubes);
    }
    this.solids = shapes.length > 0 ? new Solids(shapes) : null;
    if (this.solids) this.scene.add(this.solids);
    this.hand = this.driven.find((body) => body.joint.type === 'slide') ?? null;
    this.shadows = new Shadows(this.hand, shapes.filter((shape) => shape.name.endsWith('_tip')));
    this.scene.add(this.shadows);
    this.positions = new Array(take.joints.length).fill(0);
  }

  /** Lateral place of the hand from the keyboard's middle, m. */
  get lateral() {
    return this.hand?.position.y ?? 0;
  }

  /** Sets the pose at a time. */
  pose(secs) {
    const { take, positions } = this;
    take.positionsAt(secs, positions);
    for (const body of this.driven) body.move(positions[body.joint.drive] ?? 0);
    for (const key of this.keys) {
      key.body.move(take.keyDepth(key.pitch, secs) * key.down);
      const shows = keyKind(take.dueAt(key.pitch, secs), take.strokeAt(key.pitch, secs));
      if (key.shows === shows) continue;
      key.shows = shows;
      // A strip of size zero is invisible.
      key.strip?.scale.setScalar(shows === 'due' ? 1 : 0);
      if (key.shape) this.solids.paint(key.shape, PAINT[shows] ?? key.shape.colour);
    }
    this.arm?.pose(secs);
    this.world.updateMatrixWorld();
    this.solids?.follow();
    this.shadows.update();
  }

  /** Pitches whose key is drawn more than half down. */
  keysDown() {
    const down = this.keys.filter((key) => key.body.angle() / key.down > 0.5);
    return down.map((key) => key.pitch).sort((a, b) => a - b);
  }

  /** What each coloured key shows, by pitch. */
  keysShown() {
    return Object.fromEntries(this.keys.filter((key) => key.shows).map((key) => [key.pitch, key.shows]));
  }

  dispose() {
    this.labels.forEach(disposeLabel);
    this.solids?.dispose();
    this.shadows.dispose();
  }
}

/** A key: its body and shape, and a strip along its front half that shows when it is due. */
function keyOf(body) {
  const { key, down } = body.joint;
  const shape = body.children.find((child) => child instanceof Shape) ?? null;
  const made = { body, shape, pitch: LOWEST_PITCH + key, down, shows: null, strip: null };
  if (!shape) return made;
  const [x, y, z] = shape.size;
  made.strip = new Shape({ type: 'box', size: [0.44 * x, 0.62 * y, 0.0003], rgba: [0, 0, 0, 1] });
  made.strip.colour.set(DUE);
  made.strip.scale.setScalar(0);
  made.strip.position.copy(shape.position);
  made.strip.position.x += 0.5 * x;
  made.strip.position.z += z;
  body.add(made.strip);
  return made;
}

/** The name of a key, on it; null if it has none. */
function labelled(key) {
  const label = keyLabel(key);
  if (label) key.body.add(label);
  return label;
}

/** A light from the player's left, and ambient light from above and below. */
function lights() {
  const room = new HemisphereLight(0xffffff, 0x9a958c, 2.25);
  room.position.set(0, 0, 1);
  const lamp = new DirectionalLight(0xfff4e6, 1.05);
  lamp.position.set(0.45, -0.5, 1);
  return [room, lamp];
}
