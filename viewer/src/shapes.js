/**
 * All solid shapes as one mesh in world coordinates. A hundred small boxes have few triangles, but
 * their draw calls are slow without a graphics card; so there is one draw call, and moving vertices
 * are updated here.
 */

import {
  BoxGeometry, CapsuleGeometry, Color, CylinderGeometry, DynamicDrawUsage, Float32BufferAttribute, Matrix3, Matrix4, Mesh,
  MeshLambertMaterial, Object3D, SphereGeometry, Vector3,
} from 'three';
import { RoundedBoxGeometry } from 'three/addons/geometries/RoundedBoxGeometry.js';
import { mergeGeometries, mergeVertices } from 'three/addons/utils/BufferGeometryUtils.js';

import { place } from './bodies.js';

/** Edges of boxes thinner than this are not rounded, m. */
const THIN = 0.004;
/** Rounding of the other boxes' edges: a share of their thinnest side, and no more than this, m. */
const ROUNDING = { share: 0.15, most: 0.004 };

/** One geom, added to the tree of bodies. */
export class Shape extends Object3D {
  constructor(geom) {
    super();
    place(this, geom);
    this.name = geom.name ?? '';
    this.size = geom.size;
    this.geometry = geometryOf(geom);
    const [r, g, b] = geom.rgba ?? [0.5, 0.5, 0.5];
    this.colour = new Color().setRGB(r, g, b);
  }
}

export class Solids extends Mesh {
  /** @param {Shape[]} shapes at least one */
  constructor(shapes) {
    for (const { geometry, colour } of shapes) {
      geometry.deleteAttribute('uv');
      const colours = Array.from({ length: geometry.attributes.position.count }, () => colour.toArray()).flat();
      geometry.setAttribute('color', new Float32BufferAttribute(colours, 3));
    }
    super(mergeGeometries(shapes.map((shape) => shape.geometry)), new MeshLambertMaterial({ vertexColors: true }));
    this.frustumCulled = false;
    this.matrixAutoUpdate = false;
    for (const attribute of Object.values(this.geometry.attributes)) attribute.setUsage(DynamicDrawUsage);
    let first = 0;
    /**
     * @type {{shape: Shape, first: number, at: Matrix4}[]} each shape's first vertex, and where it
     *   was put last
     */
    this.parts = shapes.map((shape) => {
      const part = { shape, first, at: new Matrix4().makeScale(NaN, NaN, NaN) };
      first += shape.geometry.attributes.position.count;
      return part;
    });
  }

  /** Puts the vertices where the bodies have moved the shapes. */
  follow() {
    const { position, normal } = this.geometry.attributes;
    for (const { shape, first, at } of this.parts) {
      if (at.equals(shape.matrixWorld)) continue;
      at.copy(shape.matrixWorld);
      turn.setFromMatrix4(at);
      const { position: own, normal: upright } = shape.geometry.attributes;
      for (let vertex = 0; vertex < own.count; vertex += 1) {
        point.fromBufferAttribute(own, vertex).applyMatrix4(at);
        position.setXYZ(first + vertex, point.x, point.y, point.z);
        point.fromBufferAttribute(upright, vertex).applyMatrix3(turn);
        normal.setXYZ(first + vertex, point.x, point.y, point.z);
      }
      position.needsUpdate = true;
      normal.needsUpdate = true;
    }
  }

  /** Gives a shape another colour. */
  paint(shape, colour) {
    const { color } = this.geometry.attributes;
    const { first } = this.parts.find((part) => part.shape === shape);
    const { count } = shape.geometry.attributes.position;
    for (let vertex = first; vertex < first + count; vertex += 1) color.setXYZ(vertex, colour.r, colour.g, colour.b);
    color.needsUpdate = true;
  }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
  }
}

const point = new Vector3();
const turn = new Matrix3();

/** MuJoCo's sizes are half sizes, and its capsules and cylinders lie along z. */
function geometryOf({ type, size }) {
  const [a, b = a, c = b] = size;
  if (type === 'sphere') return new SphereGeometry(a, 16, 12);
  if (type === 'capsule') return new CapsuleGeometry(a, 2 * b, 5, 18).rotateX(Math.PI / 2);
  if (type === 'cylinder') return new CylinderGeometry(a, a, 2 * b, 20).rotateX(Math.PI / 2);
  const thinnest = 2 * Math.min(a, b, c);
  if (thinnest < THIN) return new BoxGeometry(2 * a, 2 * b, 2 * c);
  const box = new RoundedBoxGeometry(2 * a, 2 * b, 2 * c, 1, Math.min(ROUNDING.share * thinnest, ROUNDING.most));
  box.deleteAttribute('uv');
  return mergeVertices(box);
}
