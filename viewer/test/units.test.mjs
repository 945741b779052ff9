/** What needs no browser: kinematics, right or missed or wrong, interpolation, loops, and when notes are struck. */

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { Group, Vector3 } from 'three';

import { Arm } from '../src/arm.js';
import { bodyTree } from '../src/bodies.js';
import { keyKind, strokeKinds } from '../src/classify.js';
import { barAround } from '../src/clock.js';
import { columnsOf } from '../src/columns.js';
import { readable } from '../src/names.js';
import { SAMPLE_RATE_HZ, pitchHz, tone } from '../src/piano.js';
import { FALL_SECS, impulse } from '../src/room.js';
import { firstUnfinished, strikeOf } from '../src/schedule.js';
import { Take } from '../src/take.js';
import { comparedRows } from '../src/work/lists.js';
import { LINKS, fingertip, heldThrough, sampleTake, scene } from './sample.mjs';

const near = (actual, expected, within = 1e-9) => assert.ok(Math.abs(actual - expected) <= within, `${actual} is not ${expected}`);

test('fingertips are where the closed form has them', () => {
  const world = new Group();
  const { bodies: descriptions } = scene();
  const bodies = bodyTree(descriptions, world);
  const angles = [0.21, 0.9, 0.7, 0.4];
  const rail = -0.113;
  descriptions.forEach(({ joint }, index) => {
    if (joint?.drive === 12) bodies[index].move(rail);
    else if (joint?.drive !== undefined) bodies[index].move(angles[joint.drive % 4]);
  });
  world.updateMatrixWorld();
  ['index', 'middle', 'ring'].forEach((name, finger) => {
    const distal = bodies[descriptions.findIndex((body) => body.name === `${name}_distal`)];
    const tip = distal.localToWorld(new Vector3(0, 0, LINKS[3]));
    const expected = fingertip(finger, angles, rail);
    tip.toArray().forEach((value, axis) => near(value, expected[axis]));
  });
});

test('a key turns about its rear edge, and says by how much', () => {
  const world = new Group();
  const joint = { type: 'hinge', axis: [0, 1, 0], anchor: [-0.075, 0, 0], key: 24, down: 0.06 };
  const [key] = bodyTree([{ name: 'key_24', parent: -1, pos: [0, 0, 0.01], quat: [1, 0, 0, 0], joint }], world);
  key.move(0.06);
  world.updateMatrixWorld();
  near(key.angle(), 0.06);
  const [rear, front] = [-0.075, 0.075].map((x) => key.localToWorld(new Vector3(x, 0, 0)));
  near(rear.x, -0.075);
  near(rear.z, 0.01);
  near(front.x, -0.075 + 0.15 * Math.cos(0.06));
  near(front.z, 0.01 - 0.15 * Math.sin(0.06));
});

test('a slide moves along its axis in a turned body', () => {
  const world = new Group();
  const half = Math.SQRT1_2;
  const joint = { type: 'slide', axis: [1, 0, 0], anchor: [0, 0, 0], drive: 0 };
  const [body] = bodyTree([{ name: 'a', parent: -1, pos: [1, 2, 3], quat: [half, 0, 0, half], joint }], world);
  body.move(0.5);
  [1, 2.5, 3].forEach((value, axis) => near(body.position.getComponent(axis), value));
});

test('a stroke and a due note are judged by each other, not by control steps', () => {
  const matches = [{ note: 0, right: true }, { note: 2, right: false }, null];
  assert.deepEqual(strokeKinds(4, matches), ['right', 'wrong', 'off', 'wrong']);
  // Struck 30 ms late and released early: right all the same, and its key is due before and after the stroke.
  const due = [{ pitch: 60, start: 1, end: 2, velocity: 80 }];
  const take = new Take({ control_hz: 20, due: [[60]], due_notes: due, notes: [{ pitch: 60, start: 1.03, end: 1.6, velocity: 80 }], matches: [{ note: 0, right: true }] });
  assert.deepEqual([take.dueNotes[0].kind, take.notes[0].kind], ['right', 'right']);
  const shown = (secs) => keyKind(take.dueAt(60, secs), take.strokeAt(60, secs));
  assert.deepEqual([0.9, 1.01, 1.04, 1.59, 1.7, 2.1].map(shown), [null, 'due', 'right', 'right', 'due', null]);
});

test('a key that is held from the note before is missed, until it is struck again', () => {
  const held = new Take(heldThrough());
  const shown = (secs) => keyKind(held.dueAt(60, secs), held.strokeAt(60, secs));
  assert.deepEqual([0.5, 1.5, 2.5, 3.5].map(shown), [null, 'right', 'missed', null]);
  assert.deepEqual([{ start: 1.5 }, { start: 2.1 }].map(({ start }) => keyKind({ start: 2, kind: 'missed' }, { start, kind: 'wrong' })), ['missed', 'wrong']);
});

test('a recording without the notes that were due is not judged', () => {
  const take = new Take({ control_hz: 20, due: [[60]], notes: [{ pitch: 60, start: 0, end: 1, velocity: 80 }] });
  assert.equal(take.notes[0].kind, 'played');
  assert.match(take.remarks.join(), /its strokes are not judged/);
  const free = new Take({ control_hz: 20, due: [[]], notes: [{ pitch: 60, start: 0, end: 1, velocity: 80 }] });
  assert.equal(free.notes[0].kind, 'wrong');
});

test('a comparison lists due notes and wrong strokes in order of time', () => {
  const stroke = (error, right) => ({ onset_error_secs: error, length_error_secs: -0.0004, velocity: 80, right });
  const notes = [{ due_secs: 1, name: 'C4', played: [stroke(0.01, true), null] }, { due_secs: 2, name: 'D4', played: [stroke(0.09, false), stroke(-0.09, false)] }];
  const strays = [[{ pitch: 61, start: 1.5, end: 1.6, velocity: 40 }], [{ pitch: 70, start: 0.5, end: 0.75, velocity: 90 }]];
  assert.deepEqual(comparedRows({ notes, strays }), [
    ['0.50 s', 'A♯4', '', 'wrong stroke, 250, 90'],
    ['1.00 s', 'C4', '+10, 0, 80', 'missed'],
    ['1.50 s', 'C♯4', 'wrong stroke, 100, 40', ''],
    ['2.00 s', 'D4', '+90, 0, 80, too late', '−90, 0, 80, too early'],
  ]);
});

test('a column of a chart has the lowest, the mean and the highest of its values, and none without a value', () => {
  const values = [1, 2, 6, null, NaN, null, -1, null, -1];
  assert.deepEqual(columnsOf(values, (step) => 40 + Math.floor(step / 3)), [
    { column: 40, low: 1, mean: 3, high: 6 },
    { column: 42, low: -1, mean: -1, high: -1 },
  ]);
  assert.deepEqual(columnsOf([], () => 0), []);
});

test('notes are struck at their time, whatever the speed', () => {
  const note = { start: 10, end: 11 };
  assert.deepEqual(strikeOf(note, { song: 9, sound: 100, speed: 1 }, 100), { when: 101, into: 0, stop: 102 });
  assert.deepEqual(strikeOf(note, { song: 9, sound: 100, speed: 0.5 }, 100), { when: 102, into: 0, stop: 104 });
  assert.deepEqual(strikeOf(note, { song: 10.5, sound: 100, speed: 1 }, 100), { when: 100, into: 0.5, stop: 100.5 }, 'in its middle');
  assert.deepEqual(strikeOf(note, { song: 9, sound: 100, speed: 1 }, 100, 10.25), { when: 101, into: 0, stop: 101.25 }, 'cut by a loop');
  assert.equal(strikeOf(note, { song: 11, sound: 100, speed: 1 }, 100), null, 'over');
  assert.equal(firstUnfinished([{ start: 0, end: 5 }, { start: 1, end: 2 }], 3), 0);
  assert.equal(firstUnfinished([{ start: 0, end: 1 }], 3), 1);
});

test('the curve through positions meets every recorded row', () => {
  const take = new Take(sampleTake({ steps: 60 }));
  const out = new Array(13).fill(0);
  for (const step of [0, 17, 59]) {
    take.positionsAt((step + 1) / take.hz, out);
    out.forEach((value, joint) => near(value, take.positions[step][joint], 1e-9));
  }
  take.positionsAt(0, out);
  out.forEach((value, joint) => near(value, take.start[joint]));
});

test('a key is half down at the moment of its event', () => {
  const take = new Take({ control_hz: 20, due: [[]], notes: [{ pitch: 60, start: 1, end: 2, velocity: 80 }] });
  near(take.keyDepth(60, 1), 0.5);
  near(take.keyDepth(60, 1.5), 1);
  near(take.keyDepth(60, 0.9), 0);
  near(take.keyDepth(61, 1.5), 0);
});

test('holes in a recording keep what was there before', () => {
  const take = new Take({ control_hz: 20, joints: ['a', 'b'], positions: [[1, 2], [null, 3], null] });
  assert.deepEqual(take.positions, [[1, 2], [1, 3], [1, 3]]);
});

test('a bar is looped, or two seconds without bars', () => {
  assert.deepEqual(barAround([1, 3, 5], 3, 8), { from: 3, to: 5 });
  assert.deepEqual(barAround([1, 3, 5], 7, 8), { from: 5, to: 8 });
  assert.deepEqual(barAround([], 4, 8), { from: 3, to: 5 });
  assert.deepEqual(barAround([], 0, 1), { from: 0, to: 1 });
  assert.deepEqual(barAround([1, 3], 0.5, 8), { from: 0, to: 2 });
});

test('a tone has its pitch, and a harder stroke is louder and brighter', () => {
  const power = (samples, hz) => {
    let [re, im] = [0, 0];
    samples.forEach((sample, i) => {
      re += sample * Math.cos((2 * Math.PI * hz * i) / SAMPLE_RATE_HZ);
      im += sample * Math.sin((2 * Math.PI * hz * i) / SAMPLE_RATE_HZ);
    });
    return re * re + im * im;
  };
  near(pitchHz(69), 440);
  const [soft, hard] = [30, 110].map((velocity) => tone(69, velocity, 0.4));
  assert.ok(power(hard, 440) > 50 * power(hard, 466), 'A and not A sharp');
  const loud = (samples) => samples.reduce((most, sample) => Math.max(most, Math.abs(sample)), 0);
  assert.ok(loud(hard) > 2 * loud(soft) && loud(hard) <= 1);
  const brightness = (samples) => power(samples, 1765) / power(samples, 440);
  assert.ok(brightness(hard) > 2 * brightness(soft));
});

test('the arm\'s tubes reach from point to point, and move with them', () => {
  const points = [[0, 0, 0, 0, 0, 0.3, 0.4, 0, 0.3], [0, 0, 0, 0.3, 0, 0, 0.3, 0.4, 0]];
  const take = new Take({ ...sampleTake({ steps: 2 }), arm: { radii: [0.05, 0.04], points } });
  const arm = new Arm(take);
  for (const [row, secs] of [[0, 0.05], [1, 0.1]]) {
    arm.pose(secs);
    arm.tubes.forEach((tube, link) => {
      tube.updateMatrixWorld();
      const half = tube.size[1];
      for (const [end, point] of [[-half, link], [half, link + 1]]) {
        tube.localToWorld(new Vector3(0, 0, end)).toArray().forEach((value, axis) => near(value, points[row][3 * point + axis], 1e-6));
      }
    });
  }
  near(take.armAt(0.075)[3], 0.15);
  assert.equal(new Take(sampleTake({ steps: 2 })).arm, null);
});

test('names of keys do not touch in low rows, and every C keeps its name', () => {
  const pitches = [59, 60, 61, 62, 64, 65, 72];
  assert.deepEqual(readable(pitches, 12), [60, 72, 59, 61, 62, 64, 65]);
  assert.deepEqual(readable(pitches, 8), [60, 72, 62, 64]);
});

test('the room answers late, and falls by 60 dB in its time', () => {
  const rate = 48_000;
  const answer = impulse(rate);
  const first = answer.findIndex((sample) => Math.abs(sample) > 0.01);
  assert.ok(Math.abs(first / rate - 0.0147) < 1e-3, `${first}`);
  const level = (from, to) => {
    const part = answer.slice(from * rate, to * rate);
    return 10 * Math.log10(part.reduce((sum, sample) => sum + sample * sample, 0) / part.length);
  };
  const fall = (level(0.05, 0.15) - level(FALL_SECS - 0.1, FALL_SECS)) / (FALL_SECS - 0.15);
  // High notes fall faster than by 60 dB.
  assert.ok(fall * FALL_SECS > 55 && fall * FALL_SECS < 90, `${fall * FALL_SECS} dB`);
});
