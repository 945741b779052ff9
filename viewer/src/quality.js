/** The frame rate, and the resolution at which it is high enough. */

const SLOW_FRAME_MS = 20;
const COARSEST = 0.5;
/**
 * Resolution of still pictures, in multiples of the screen's, which smooths edges without
 * antialiasing.
 */
const STILL = 2;

/** Whether there is no graphics card, or none that the browser may use. */
export const DRAWN_BY_PROCESSOR = (() => {
  const context = document.createElement('canvas').getContext('webgl2');
  const info = context?.getExtension('WEBGL_debug_renderer_info');
  const name = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : '';
  context?.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
})();

/** Time over which the rate is measured, and to wait after a change. */
const JUDGED_MS = 500;
const COUNTED_MS = 2000;

export class Quality {
  constructor() {
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    /** For still pictures. */
    this.finest = DRAWN_BY_PROCESSOR ? STILL : this.ratio;
    /** Whether the machine is too slow for everything to move in every frame. */
    this.slow = DRAWN_BY_PROCESSOR;
    this.begin();
  }

  /** Call when playing begins, so that the pause before does not count as a slow frame. */
  begin() {
    this.frames = [];
    this.judged = { since: null, frames: 0 };
  }

  /** Counts a frame that was drawn while playing; `now` in ms. */
  frame(now) {
    this.frames.push(now);
    while (this.frames[0] < now - COUNTED_MS) this.frames.shift();
    this.judged.since ??= now;
    const span = now - this.judged.since;
    if (span < JUDGED_MS) {
      this.judged.frames += 1;
      return;
    }
    const mean = span / this.judged.frames;
    if (mean > SLOW_FRAME_MS) this.slow = true;
    if (mean > SLOW_FRAME_MS) this.ratio = Math.max(COARSEST, 0.8 * this.ratio);
    this.judged = { since: now, frames: 1 };
  }

  fps() {
    const count = this.frames.length - 1;
    return count > 0 ? (1000 * count) / (this.frames[count] - this.frames[0]) : 0;
  }
}
