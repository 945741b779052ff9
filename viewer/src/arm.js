/**
 * The arm that carries the hand: tubes between points of its links, which a recording of a robot
 * has.
 */

import { Vector3 } from 'three';

import { Shape } from './shapes.js';

const COLOUR = [0.86, 0.87, 0.88, 1];

export class Arm {
  /** @param {import('./take.js').Take} take one with an arm */
  constructor(take) {
    this.take = take;
    const first = pointsOf(take.arm.points[0]);
    this.tubes = take.arm.radii.map((radius, link) => {
      const length = first[link].distanceTo(first[link + 1]);
      return new Shape({ name: 'arm', type: 'capsule', size: [radius, length / 2], rgba: COLOUR });
    });
  }

  pose(secs) {
    const points = pointsOf(this.take.armAt(secs));
    this.tubes.forEach((tube, link) => {
      const [from, to] = [points[link], points[link + 1]];
      tube.position.copy(from).add(to).multiplyScalar(0.5);
      tube.quaternion.setFromUnitVectors(ALONG, to.clone().sub(from).normalize());
    });
  }
}

/** Capsules lie along z. */
const ALONG = new Vector3(0, 0, 1);

const pointsOf = (row) => Array.from({ length: row.length / 3 }, (_, point) => new Vector3(...row.slice(3 * point, 3 * point + 3)));
