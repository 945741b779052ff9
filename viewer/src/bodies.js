/**
 * The tree of bodies, with MuJoCo's meaning of joints: body frame = parent frame · (pos, quat) ·
 * joint motion.
 */

import { Group, Quaternion, Vector3 } from 'three';

const vector = ([x, y, z]) => new Vector3(x, y, z);
/** MuJoCo writes w first, three last. */
const quaternion = ([w, x, y, z]) => new Quaternion(x, y, z, w).normalize();

/** Sets the pose of an object to that of a body or geom. */
export function place(object, { pos, quat }) {
  object.position.copy(vector(pos ?? [0, 0, 0]));
  object.quaternion.copy(quaternion(quat ?? [1, 0, 0, 0]));
}

export class Body extends Group {
  constructor(description) {
    super();
    place(this, description);
    this.joint = description.joint ?? null;
    if (!this.joint) return;
    this.home = { position: this.position.clone(), quaternion: this.quaternion.clone() };
    this.axis = vector(this.joint.axis).normalize();
    this.anchor = vector(this.joint.anchor ?? [0, 0, 0]);
  }

  /** Moves the body's joint to a position, rad or m. */
  move(position) {
    const { home, axis, anchor } = this;
    if (this.joint.type === 'slide') {
      this.position.copy(axis).multiplyScalar(position);
    } else {
      // A rotation about the anchor is a rotation about the origin and a shift.
      turn.setFromAxisAngle(axis, position);
      this.position.copy(anchor).sub(shift.copy(anchor).applyQuaternion(turn));
      this.quaternion.copy(home.quaternion).multiply(turn);
    }
    this.position.applyQuaternion(home.quaternion).add(home.position);
  }

  /** The current angle of a hinge, rad; signed about its axis. */
  angle() {
    turn.copy(this.home.quaternion).conjugate().multiply(this.quaternion);
    return 2 * Math.atan2(shift.set(turn.x, turn.y, turn.z).dot(this.axis), turn.w);
  }
}

// Scratch of the two methods above, which run for every body in every frame.
const turn = new Quaternion();
const shift = new Vector3();

/**
 * All bodies of a scene, in its order, added to `world` or to their parents.
 * @returns {Body[]}
 */
export function bodyTree(descriptions, world) {
  const bodies = descriptions.map((description) => new Body(description));
  bodies.forEach((body, index) => (bodies[descriptions[index].parent] ?? world).add(body));
  return bodies;
}
