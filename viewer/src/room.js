/**
 * A small room around the tones: the same feedback delay network (Jot and Chaigne, 1991) as that of
 * the WAV files.
 */

/** Lengths of the delay lines, s: distances of some metres, without a common divisor. */
const DELAYS_SECS = [0.0147, 0.0179, 0.0211, 0.0239, 0.0277, 0.0319, 0.0353, 0.0397];
/** Time in which the reverberation falls by 60 dB, s. */
export const FALL_SECS = 0.7;
/** Low-pass share of each reflection: walls absorb high notes first. */
const DULLNESS = 0.35;
/** Level of the reverberation relative to the direct sound. */
const WET = 0.16;

/**
 * The impulse response of the room without the direct sound.
 *
 * @param {number} rate samples a second
 * @returns {Float32Array}
 */
export function impulse(rate) {
  const lines = DELAYS_SECS.map((secs) => ({
    samples: new Float32Array(Math.round(secs * rate)),
    at: 0,
    gain: 10 ** ((-3 * secs) / FALL_SECS),
    dull: 0,
  }));
  const answer = new Float32Array(Math.round(FALL_SECS * rate));
  for (let i = 0; i < answer.length; i += 1) {
    const reflections = lines.map((line) => {
      line.dull += (1 - DULLNESS) * (line.samples[line.at] - line.dull);
      return line.gain * line.dull;
    });
    const sum = reflections.reduce((all, one) => all + one, 0);
    // The Householder matrix mixes all lines and keeps their energy.
    const mixed = (2 / lines.length) * sum;
    lines.forEach((line, index) => {
      line.samples[line.at] = (i === 0 ? 1 : 0) + reflections[index] - mixed;
      line.at = (line.at + 1) % line.samples.length;
    });
    answer[i] = WET * sum;
  }
  return answer;
}
