/**
 * A made-up take for tests and for working on the page without a recording: Twinkle Twinkle played by a scripted hand
 * on the keyboard and hand of the stage, with a few mistakes. Numbers are those of crates/stage.
 */

export const HZ = 20;
const KEYS = 49;
const LOWEST = 36;
const WHITE_PITCH = 0.674 / 29;
const WHITE = { size: [0.15, 0.0225, 0.0225], x: 0, z: 0.01125, travel: 0.01 };
const BLACK = { size: [0.09, 0.01, 0.018], x: -0.03, z: 0.026, travel: 0.007 };
const MOUNT = [0.1, 0.12];
const ROOT_SPACING = 0.0435;
const SPLAY = (5 * Math.PI) / 180;
const ROOT_Z = [-0.001542, 0.0007];
export const LINKS = [0.0164, 0.054, 0.0384, 0.045];
const FINGERS = ['index', 'middle', 'ring'];

export const isBlack = (key) => [1, 3, 6, 8, 10].includes(key % 12);

function lateral(key) {
  let whites = 0;
  for (let k = 0; k < key; k += 1) whites += isBlack(k) ? 0 : 1;
  return (whites - (isBlack(key) ? 0.5 : 0) - 14) * WHITE_PITCH;
}

/** Side of a left hand's finger in the palm frame. */
const side = (finger) => finger - 1;

export function scene() {
  const half = (size) => size.map((value) => value / 2);
  const bodies = [];
  const geoms = [];
  const body = (name, parent, pos, quat, joint) => bodies.push({ name, parent, pos, quat, joint }) - 1;
  const geom = (owner, name, type, size, pos, rgba, quat = [1, 0, 0, 0]) => geoms.push({ body: owner, name, type, size, pos, quat, rgba });
  const keyboard = body('keyboard', -1, [0, 0, 0], [1, 0, 0, 0], null);
  geom(keyboard, '', 'box', [0.05, 0.357, 0.02], [-0.125, 0, 0.02], [0.15, 0.15, 0.17, 1]);
  const top = 0.0205;
  for (let key = 0; key < KEYS - 1; key += 1) {
    if (isBlack(key)) continue;
    const rear = isBlack(key + 1) ? 0.017 : -0.075;
    geom(keyboard, `fence_${key}`, 'box', [(0.075 - rear) / 2, (WHITE_PITCH - 0.0225) / 2, top / 2], [(rear + 0.075) / 2, lateral(key) + WHITE_PITCH / 2, top / 2], [0.9, 0.75, 0.1, 1]);
  }
  for (let key = 0; key < KEYS; key += 1) {
    const shape = isBlack(key) ? BLACK : WHITE;
    const joint = { type: 'hinge', axis: [0, 1, 0], anchor: [-shape.size[0] / 2, 0, 0], key, down: Math.atan(shape.travel / shape.size[0]) };
    const owner = body(`key_${key}`, -1, [shape.x, lateral(key), shape.z], [1, 0, 0, 0], joint);
    geom(owner, `key_${key}`, 'box', half(shape.size), [0, 0, 0], isBlack(key) ? [0.08, 0.08, 0.08, 1] : [0.95, 0.95, 0.93, 1]);
  }
  const palm = body('palm', -1, [MOUNT[0], 0, MOUNT[1]], [0, Math.SQRT1_2, 0, -Math.SQRT1_2], { type: 'slide', axis: [0, -1, 0], anchor: [0, 0, 0], drive: 12 });
  geom(palm, '', 'box', [0.0204, 0.0565, 0.0475], [-0.0093, 0, -0.0475], [0.2, 0.2, 0.22, 1]);
  geom(palm, 'thumb', 'capsule', [0.012, 0.033], [-0.018, -0.0725, -0.013], [0.25, 0.25, 0.27, 1], [Math.cos(0.019), Math.sin(0.019), 0, 0]);
  FINGERS.forEach((name, finger) => {
    const s = side(finger);
    const turn = (-s * SPLAY) / 2;
    const drive = (number, axis) => ({ type: 'hinge', axis, anchor: [0, 0, 0], drive: 4 * finger + number });
    const link = (owner, part, length) => geom(owner, `${name}_${part}`, 'box', [0.0098, 0.01375, length / 2], [0, 0, length / 2], [0.3, 0.3, 0.33, 1]);
    const base = body(`${name}_base`, palm, [0, s * ROOT_SPACING, ROOT_Z[s === 0 ? 1 : 0]], [Math.cos(turn), Math.sin(turn), 0, 0], drive(0, [0, 0, 1]));
    link(base, 'base', LINKS[0]);
    const proximal = body(`${name}_proximal`, base, [0, 0, LINKS[0]], [1, 0, 0, 0], drive(1, [0, 1, 0]));
    link(proximal, 'proximal', LINKS[1]);
    const medial = body(`${name}_medial`, proximal, [0, 0, LINKS[1]], [1, 0, 0, 0], drive(2, [0, 1, 0]));
    link(medial, 'medial', LINKS[2]);
    const distal = body(`${name}_distal`, medial, [0, 0, LINKS[2]], [1, 0, 0, 0], drive(3, [0, 1, 0]));
    link(distal, 'distal', 0.016);
    geom(distal, `${name}_tip`, 'capsule', [0.0085, 0.016], [0, 0, 0.029], [0.95, 0.95, 0.9, 1]);
  });
  return { bodies, geoms };
}

const rootLateral = (finger) => -side(finger) * ROOT_SPACING;

/** Centre of the rounded fingertip in closed form, m: what the tree of bodies must give. */
export function fingertip(finger, angles, rail) {
  const s = side(finger);
  const tilt = -s * SPLAY;
  let [forward, down, sum] = [0, 0, 0];
  for (let joint = 1; joint < 4; joint += 1) {
    sum += angles[joint];
    forward += LINKS[joint] * Math.cos(sum);
    down += LINKS[joint] * Math.sin(sum);
  }
  const along = LINKS[0] + forward;
  const aside = -down * Math.sin(angles[0]);
  return [
    MOUNT[0] - ROOT_Z[s === 0 ? 1 : 0] - along * Math.cos(tilt) + aside * Math.sin(tilt),
    rootLateral(finger) + rail + along * Math.sin(tilt) + aside * Math.cos(tilt),
    MOUNT[1] - down * Math.cos(angles[0]),
  ];
}

/** Joint angles that bring a straight-ahead fingertip to depth `x` and height `z`, tip upright. */
function reach(finger, x, z) {
  const along = MOUNT[0] - ROOT_Z[side(finger) === 0 ? 1 : 0] - x - LINKS[0];
  const down = MOUNT[1] - z - LINKS[3];
  const [a, b] = [LINKS[1], LINKS[2]];
  const cosine = (along * along + down * down - a * a - b * b) / (2 * a * b);
  const second = Math.acos(Math.min(1, Math.max(-1, cosine)));
  const first = Math.atan2(down, along) - Math.atan2(b * Math.sin(second), a + b * Math.cos(second));
  return [0, first, second, Math.PI / 2 - first - second];
}

const TUNE = [60, 60, 67, 67, 69, 69, 67, 0, 65, 65, 64, 64, 62, 62, 60, 0, 67, 67, 65, 65, 64, 64, 62, 0, 67, 67, 65, 65, 64, 64, 62, 0, 60, 60, 67, 67, 69, 69, 67, 0, 65, 65, 64, 64, 62, 62, 60, 0];
const SILENCE_SECS = 1;
const BEAT_SECS = 32 / TUNE.length;

/** What is due: each note of the tune, two beats at the phrase's end, with a third above it now and then. */
function score() {
  const due = [];
  TUNE.forEach((pitch, beat) => {
    if (pitch === 0) return;
    const long = TUNE[beat + 1] === 0;
    const start = SILENCE_SECS + beat * BEAT_SECS;
    const end = start + BEAT_SECS * (long ? 1.9 : 0.85);
    due.push({ pitch, start, end, velocity: 78 });
    if (long) due.push({ pitch: pitch + 4, start, end, velocity: 66 });
  });
  return due;
}

/** A repeatable random number in [0, 1). */
function randomFrom(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

const smooth = (u) => {
  const v = Math.min(1, Math.max(0, u));
  return v * v * (3 - 2 * v);
};

/** What the scripted hand plays of it: late, sometimes not at all, sometimes beside it. */
function playing(due, seed) {
  const random = randomFrom(seed);
  return due.flatMap((note) => {
    const luck = random();
    const late = 0.02 + 0.05 * random();
    const velocity = Math.round(note.velocity + 30 * (random() - 0.5));
    if (luck < 0.05) return [];
    const pitch = luck < 0.11 ? note.pitch + 1 : note.pitch;
    return [{ pitch, start: note.start + late, end: note.end + 0.04 * random(), velocity }];
  }).sort((a, b) => a.start - b.start);
}

const UP = 0.05;
/** Height of a fingertip's rounded end over a key that is down or at rest, m. */
const tipOn = (key) => (isBlack(key) ? 0.037 : 0.0245);
const depthOf = (key) => (isBlack(key) ? -0.005 : 0.03);

/** Joint positions at a time: the middle finger over the tune, the index finger a third above it. */
function handAt(notes, secs) {
  const row = new Array(13).fill(0);
  const rails = notes.filter((note, i) => i === 0 || note.start > notes[i - 1].start + 0.2);
  const next = rails.findIndex((note) => note.start > secs);
  const railOf = (note) => lateral(note.pitch - LOWEST);
  const now = rails[next < 0 ? rails.length - 1 : Math.max(0, next - 1)];
  const then = rails[Math.max(0, next)] ?? now;
  row[12] = railOf(now) + (railOf(then) - railOf(now)) * smooth((secs - now.end) / Math.max(0.05, then.start - 0.03 - now.end));
  FINGERS.forEach((_, finger) => {
    const over = row[12] + rootLateral(finger);
    let height = UP;
    let depth = 0.03;
    for (const note of notes) {
      const key = note.pitch - LOWEST;
      if (Math.abs(lateral(key) - over) > 0.012) continue;
      const down = smooth((secs - note.start + 0.12) / 0.12) * smooth((note.end + 0.1 - secs) / 0.1);
      height = Math.min(height, UP + (tipOn(key) - UP) * down);
      if (down > 0) depth = depthOf(key);
    }
    reach(finger, depth, height).forEach((angle, joint) => {
      row[4 * finger + joint] = angle;
    });
  });
  return row;
}

const at = (notes, secs) => [...new Set(notes.filter((note) => note.start <= secs && secs < note.end).map((note) => note.pitch))].sort((a, b) => a - b);

function scores(due, pressed) {
  const running = { f1: [], precision: [], recall: [] };
  const sums = { f1: 0, precision: 0, recall: 0 };
  due.forEach((asked, step) => {
    const hits = asked.filter((pitch) => pressed[step].includes(pitch)).length;
    const precision = pressed[step].length ? hits / pressed[step].length : 1;
    const recall = asked.length ? hits / asked.length : 1;
    const both = { precision, recall, f1: precision + recall > 0 ? (2 * precision * recall) / (precision + recall) : 0 };
    for (const name of Object.keys(sums)) {
      sums[name] += both[name];
      running[name].push(sums[name] / (step + 1));
    }
  });
  return running;
}

/** The due notes, and by which stroke each was played. */
function noteByNote(due, notes) {
  const left = new Set(notes.keys());
  const matches = due.map((note) => {
    const found = [...left].find((index) => notes[index].pitch === note.pitch && Math.abs(notes[index].start - note.start) < 0.2);
    if (found === undefined) return null;
    left.delete(found);
    return { note: found, right: notes[found].start - note.start <= 0.05 };
  });
  const matched = matches.filter((one) => one?.right).length;
  return { due_notes: due, matches, note_scores: due.length ? { matched, missed: due.length - matched, wrong: notes.length - matched } : null };
}

/** One take, as etude would write it. */
export function sampleTake({ seed = 7, rig = 'simulation', mode = '', steps = 661, marks = [] } = {}) {
  const secs = steps / HZ;
  const due = score();
  const played = playing(due, seed);
  const notes = played.filter((note) => note.start < secs).map((note) => ({ ...note, end: Math.min(note.end, secs) }));
  const each = (make) => Array.from({ length: steps }, (_, step) => make(step));
  const dueSteps = each((step) => at(due, step / HZ + 1e-6));
  const pressed = each((step) => at(notes, (step + 1) / HZ));
  const running = scores(dueSteps, pressed);
  const last = (values) => values.at(-1) ?? 0;
  const rows = each((step) => handAt(played, (step + 1) / HZ).map((value) => Number(value.toFixed(5))));
  const key = (step) => (dueSteps[step].every((pitch) => pressed[step].includes(pitch)) ? 0.5 : 0.1) + (pressed[step].every((pitch) => dueSteps[step].includes(pitch)) ? 0.5 : 0);
  return {
    name: `out/twinkle-${rig}/recording.mcap`,
    song: 'Twinkle Twinkle Little Star',
    player: 'twinkle.safetensors',
    rig,
    mode,
    control_hz: HZ,
    bar_secs: Array.from({ length: TUNE.length / 4 }, (_, bar) => SILENCE_SECS + bar * 4 * BEAT_SECS),
    incomplete: null,
    scene: scene(),
    joints: [...FINGERS.flatMap((name) => [0, 1, 2, 3].map((joint) => `${name}_${joint}`)), 'rail'],
    positions: rows,
    start: handAt(played, 0),
    due: dueSteps,
    pressed,
    notes,
    ...noteByNote(due.filter((note) => note.start < secs), notes),
    running,
    final: steps > 0 ? { f1: last(running.f1), precision: last(running.precision), recall: last(running.recall), pooled_f1: 0.91 } : null,
    rewards: [
      { name: 'key_press', values: each(key) },
      { name: 'optimal_transport', values: each((step) => 0.6 + 0.4 * Math.exp(-Math.abs(rows[step][12]) * 20)) },
      { name: 'energy', values: each((step) => -0.05 * Math.abs(rows[step][12] - (rows[step - 1] ?? rows[step])[12]) * 20) },
      { name: 'delta_action', values: each((step) => -0.02 * Math.abs(Math.sin(step / 9))) },
      { name: 'collision', values: each((step) => (step % 97 < 2 ? 0 : 0.5)) },
    ],
    rewards_note: null,
    marks,
  };
}

/** A note that is due twice, with a key that is held through from the first to the second. */
export function heldThrough() {
  const due = [{ pitch: 60, start: 1, end: 2, velocity: 80 }, { pitch: 60, start: 2, end: 3, velocity: 80 }];
  const notes = [{ pitch: 60, start: 1, end: 3, velocity: 80 }];
  const keys = (all) => Array.from({ length: 80 }, (_, step) => at(all, step / HZ + 1e-6));
  return { ...sampleTake({ steps: 80 }), due: keys(due), pressed: keys(notes), notes, ...noteByNote(due, notes) };
}

/** Stretches in which two takes sound different keys, joined over gaps of a step. */
export function differencesOf(one, other) {
  const found = [];
  const steps = Math.min(one.pressed.length, other.pressed.length);
  for (let step = 0; step < steps; step += 1) {
    if (String(one.pressed[step]) === String(other.pressed[step])) continue;
    const [from, to] = [step / HZ, (step + 1) / HZ];
    const last = found.at(-1);
    if (last && from - last[1] < 1.5 / HZ) last[1] = to;
    else found.push([from, to]);
  }
  return found.filter(([from, to]) => to - from > 1.5 / HZ);
}

export function oneTake() {
  const marks = [
    { secs: 0.4, kind: 'phase', text: 'homing done' },
    { secs: 9.1, kind: 'warning', text: 'a command came 12 ms late' },
    { secs: 14.6, kind: 'clamp', text: 'middle_1 held at its limit' },
    { secs: 21.35, kind: 'fault', text: 'no answer from the hand for 40 ms' },
  ];
  return { version: 1, takes: [sampleTake({ marks })], differences: [] };
}

export function twoTakes() {
  const one = sampleTake({ seed: 7 });
  const marks = [{ secs: 12.2, kind: 'warning', text: 'a command came 12 ms late' }, { secs: 12.9, kind: 'clamp', text: 'rail held at its speed limit' }];
  const other = sampleTake({ seed: 29, rig: 'twin', mode: 'hybrid', marks });
  return { version: 1, takes: [one, other], differences: differencesOf(one, other) };
}
