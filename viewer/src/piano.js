/**
 * Synthesis of a piano tone: partials of a stiff string, each with a fast decaying prompt sound and
 * a quieter, slightly detuned aftersound that decays slowly, and the knock of the hammer.
 */

export const SAMPLE_RATE_HZ = 32000;
const PARTIALS = 14;
/** Where along the string the hammer strikes: partials with a node there are weak. */
const HAMMER_PLACE = 1 / 8;
/**
 * Seconds in which the prompt sound of middle C's fundamental falls to 1/e; shorter the higher the
 * note.
 */
const PROMPT_SECS = 0.7;
/** The aftersound: its share of the onset, how much longer it rings, and its detuning. */
const AFTER = { share: 0.22, longer: 5, detuned: 1.0004 };
const ATTACK_SECS = 0.002;
/** The knock: level beside the tone and time to fall to 1/e. */
const KNOCK = { level: 0.12, secs: 0.012 };

export const pitchHz = (pitch) => 440 * 2 ** ((pitch - 69) / 12);

/**
 * @param {number} pitch MIDI
 * @param {number} velocity 1 to 127
 * @param {number} secs how much of the tone is wanted
 * @returns {Float32Array}
 */
export function tone(pitch, velocity, secs) {
  const samples = new Float32Array(Math.ceil(secs * SAMPLE_RATE_HZ));
  const octaves = (pitch - 60) / 12;
  const force = velocity / 127;
  const fundamental = pitchHz(pitch);
  const stiffness = 3.5e-4 * 2 ** (octaves * 1.2);
  // Harder strokes are brighter; high strings have fewer overtones.
  const slope = 1.9 - 1.1 * force + 0.25 * octaves;
  for (let n = 1; n <= PARTIALS; n += 1) {
    const hz = fundamental * n * Math.sqrt(1 + stiffness * n * n);
    if (hz > SAMPLE_RATE_HZ * 0.45) break;
    const level = Math.abs(Math.sin(Math.PI * n * HAMMER_PLACE)) * n ** -slope;
    const ring = (PROMPT_SECS * 2 ** (-0.6 * octaves)) / (0.6 + 0.4 * n);
    decay(samples, hz, level * (1 - AFTER.share), ring);
    decay(samples, hz * AFTER.detuned, level * AFTER.share, ring * AFTER.longer);
  }
  knock(samples, force);
  const attack = ATTACK_SECS * SAMPLE_RATE_HZ;
  for (let i = 0; i < attack && i < samples.length; i += 1) samples[i] *= i / attack;
  let peak = 1e-9;
  for (const sample of samples) peak = Math.max(peak, Math.abs(sample));
  const gain = (0.08 + 0.92 * force ** 1.6) / peak;
  for (let i = 0; i < samples.length; i += 1) samples[i] *= gain;
  return samples;
}

/** Adds a decaying sine: a rotating and shrinking vector, whose height is the sample. */
function decay(samples, hz, level, secs) {
  const shrink = Math.exp(-1 / (secs * SAMPLE_RATE_HZ));
  const angle = (2 * Math.PI * hz) / SAMPLE_RATE_HZ;
  const c = Math.cos(angle) * shrink;
  const s = Math.sin(angle) * shrink;
  let x = level;
  let y = 0;
  for (let i = 0; i < samples.length && Math.abs(x) + Math.abs(y) > 1e-5; i += 1) {
    samples[i] += y;
    const turned = x * c - y * s;
    y = x * s + y * c;
    x = turned;
  }
}

/**
 * Adds low-pass noise that decays at once. It is the same in every tone, so that a replay always
 * sounds the same.
 */
function knock(samples, force) {
  const span = Math.min(samples.length, Math.ceil(8 * KNOCK.secs * SAMPLE_RATE_HZ));
  let seed = 1;
  let dull = 0;
  for (let i = 0; i < span; i += 1) {
    seed = (Math.imul(seed, 1664525) + 1013904223) | 0;
    dull += 0.15 * (seed / 2 ** 31 - dull);
    samples[i] += KNOCK.level * force * 4 * dull * Math.exp(-i / (KNOCK.secs * SAMPLE_RATE_HZ));
  }
}
