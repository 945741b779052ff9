/** Due keys compared with played keys, step by step, as F1 counts them; but a note that was not struck is missed also if its key was held. */

/** @typedef {{pitch: number, from: number, to: number, kind: 'hit'|'missed'|'wrong'}} Stripe steps `from` up to `to` */

/**
 * Runs of steps in which a pitch was hit, missed or wrong.
 * @param {number[][]} due pitches due in each step
 * @param {number[][]} pressed pitches sounding at the end of each step
 * @param {number[][]} unstruck those of the due pitches whose note was not struck
 * @returns {Stripe[]} sorted by their first step, then pitch
 */
export function stripes(due, pressed, unstruck = []) {
  const steps = Math.max(due.length, pressed.length);
  /** @type {Map<number, Stripe>} the stripes that include the previous step, by pitch */
  let open = new Map();
  const all = [];
  for (let step = 0; step < steps; step += 1) {
    const still = new Map();
    for (const [pitch, kind] of kinds(due[step] ?? [], pressed[step] ?? [], unstruck[step])) {
      let stripe = open.get(pitch);
      if (stripe?.kind === kind) {
        stripe.to = step + 1;
      } else {
        stripe = { pitch, from: step, to: step + 1, kind };
        all.push(stripe);
      }
      still.set(pitch, stripe);
    }
    open = still;
  }
  return all.sort((a, b) => a.from - b.from || a.pitch - b.pitch);
}

/**
 * The kind of every pitch that is due or pressed in one step.
 * @returns {Map<number, Stripe['kind']>}
 */
export function kinds(due, pressed, unstruck = []) {
  const kinds = new Map();
  for (const pitch of due) kinds.set(pitch, pressed.includes(pitch) && !unstruck.includes(pitch) ? 'hit' : 'missed');
  for (const pitch of pressed) if (!due.includes(pitch)) kinds.set(pitch, 'wrong');
  return kinds;
}
