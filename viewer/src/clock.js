/** Time: a clock that follows the sound card if there is sound, and the place in the song. */

/**
 * Rate at which the clock follows the sound card's from frame to frame; that one advances in
 * blocks.
 */
const FOLLOW = 0.1;
/** Difference from which on the clock jumps, because the sound was interrupted. */
const JUMP_SECS = 0.05;

/**
 * Seconds of the sound card while it runs, else of the machine's clock, without jumps between the
 * two.
 */
export class Timebase {
  constructor() {
    this.offset = 0;
    /** @type {AudioContext | null} */
    this.context = null;
    /** What to add for the sound card's time; null while it does not run. */
    this.toSound = null;
  }

  now() {
    const machine = performance.now() / 1000;
    if (this.context?.state !== 'running') {
      this.toSound = null;
      return machine + this.offset;
    }
    // The sound of now was computed one output latency ago.
    const audible = this.context.currentTime - (this.context.outputLatency || 0);
    this.toSound ??= audible - (machine + this.offset);
    const behind = audible - this.toSound - (machine + this.offset);
    this.offset += Math.abs(behind) > JUMP_SECS ? behind : FOLLOW * behind;
    return machine + this.offset;
  }
}

/** The place in the song. Calls `changed` whenever it moves other than by playing on. */
export class Player {
  constructor(timebase, duration) {
    this.timebase = timebase;
    this.duration = duration;
    this.speed = 1;
    this.playing = false;
    /** @type {{from: number, to: number} | null} */
    this.loop = null;
    this.changed = () => {};
    this.anchor = { song: 0, base: 0 };
  }

  /** Current song time, s; repeats in a loop and stops at the end. */
  time() {
    if (!this.playing) return this.anchor.song;
    const base = this.timebase.now();
    const song = this.anchor.song + (base - this.anchor.base) * this.speed;
    if (this.loop && song >= this.loop.to) {
      const { from, to } = this.loop;
      this.#move(from + ((song - to) % (to - from)), base);
    } else if (song >= this.duration) {
      this.playing = false;
      this.#move(this.duration, base);
    } else {
      return song;
    }
    return this.anchor.song;
  }

  play() {
    if (this.duration === 0) return;
    const song = this.time() >= this.duration ? (this.loop?.from ?? 0) : this.time();
    this.playing = true;
    this.#move(song);
  }

  pause() {
    const song = this.time();
    this.playing = false;
    this.#move(song);
  }

  seek(secs) {
    const song = Math.min(Math.max(Number(secs) || 0, 0), this.duration);
    // A seek to outside the loop ends the loop.
    if (this.loop && (song < this.loop.from || song >= this.loop.to)) this.loop = null;
    this.#move(song);
  }

  setSpeed(speed) {
    const song = this.time();
    this.speed = speed;
    this.#move(song);
  }

  setLoop(loop) {
    const song = this.time();
    this.loop = loop;
    this.#move(song);
  }

  #move(song, base = this.timebase.now()) {
    this.anchor = { song, base };
    this.changed();
  }
}

/** The bar around a place, or two seconds around it where the song has no bar lines. */
export function barAround(bars, secs, duration) {
  const next = bars.findIndex((bar) => bar > secs + 1e-6);
  if (bars.length < 2 || next === 0) return around(secs, duration);
  const from = bars[next < 0 ? bars.length - 1 : next - 1];
  const to = Math.min(next < 0 ? duration : bars[next], duration);
  return to - from > 0.1 ? { from, to } : around(secs, duration);
}

function around(secs, duration) {
  const from = Math.max(0, Math.min(secs - 1, duration - 2));
  return { from, to: Math.min(from + 2, duration) };
}
