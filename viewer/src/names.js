/** Which names of keys are written beside a piano roll. */

/** Least distance of two names, in pixels. */
const LINE = 10;

/**
 * The pitches whose names do not touch in rows of this height, in pixels: every C, and what is
 * clear of those before it.
 */
export function readable(pitches, rowHeight) {
  const ordered = [...pitches].sort((a, b) => (a % 12 !== 0) - (b % 12 !== 0) || a - b);
  const named = [];
  for (const pitch of ordered) {
    if (named.every((other) => Math.abs(other - pitch) * rowHeight >= LINE)) named.push(pitch);
  }
  return named;
}
