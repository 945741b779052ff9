/** Notes as sound: the next notes are scheduled in WebAudio with their exact times. */

import { SAMPLE_RATE_HZ, tone } from './piano.js';
import { impulse } from './room.js';
import { firstUnfinished, strikeOf } from './schedule.js';

/** How far ahead notes are scheduled, s: a hidden tab's timers come only once a second. */
const AHEAD_SECS = 1.2;
const PUMP_MS = 50;
/** The damper: time to fall to 1/e, s. */
const DAMPER_SECS = 0.025;
/** Tones of velocities this close share a buffer. */
const VELOCITY_BUCKET = 12;
/** Half speed is the slowest, and a tone longer than this has died away. */
const MAX_SECS = 6;
/** Level of one full stroke, so that a chord of a few stays below the limiter. */
const HEADROOM = 0.45;

export class Sound {
  constructor(player, timebase) {
    this.player = player;
    this.timebase = timebase;
    this.volume = 0.8;
    this.muted = false;
    this.notes = [];
    this.next = 0;
    this.buffers = new Map();
    this.voices = new Set();
    /** @type {{pitch: number, when: number, velocity: number}[]} every note ever scheduled */
    this.scheduled = [];
    setInterval(() => this.pump(), PUMP_MS);
  }

  /** Chooses the notes that sound. */
  listenTo(notes) {
    this.notes = notes;
    this.longest = Math.min(MAX_SECS, 2 * Math.max(0.5, ...notes.map((note) => note.end - note.start)) + 0.2);
    this.buffers.clear();
    this.restart();
    this.#prepare(notes);
  }

  /** Browsers let sound begin only in answer to a gesture: playing is one. */
  begin() {
    if (!this.timebase.context && window.AudioContext) {
      const context = new AudioContext({ latencyHint: 'interactive' });
      this.master = context.createGain();
      // Keeps chords from clipping.
      const limiter = new DynamicsCompressorNode(context, { threshold: -10, ratio: 12, attack: 0.003, release: 0.1 });
      this.master.connect(limiter).connect(context.destination);
      this.master.connect(roomIn(context)).connect(limiter);
      this.timebase.context = context;
      this.#setGain();
    }
    // May be refused; the picture then runs on the machine's clock, in silence.
    this.timebase.context?.resume().catch(() => {});
  }

  setVolume(volume) {
    this.volume = volume;
    this.#setGain();
  }

  setMuted(muted) {
    this.muted = muted;
    this.#setGain();
  }

  /** Stops all sounds and restarts from the player's place. */
  restart() {
    const now = this.timebase.context?.currentTime ?? 0;
    for (const { source, gain } of this.voices) {
      gain.gain.cancelScheduledValues(now);
      gain.gain.setTargetAtTime(0, now, DAMPER_SECS / 2);
      source.stop(now + 6 * DAMPER_SECS);
    }
    this.voices.clear();
    this.next = firstUnfinished(this.notes, this.player.anchor.song);
    this.pump();
  }

  /** Schedules the notes of the next second or so. */
  pump() {
    if (!this.player.playing) return;
    const song = this.player.time();
    const base = this.timebase.now();
    if (this.timebase.toSound === null || !this.player.playing) return;
    const { speed, loop } = this.player;
    const anchor = { song, sound: base + this.timebase.toSound, speed };
    const until = loop?.to ?? Infinity;
    const horizon = Math.min(song + AHEAD_SECS * speed, until);
    for (; this.next < this.notes.length && this.notes[this.next].start < horizon; this.next += 1) {
      const note = this.notes[this.next];
      const strike = strikeOf(note, anchor, this.timebase.context.currentTime, until);
      if (strike) this.#strike(note, strike);
    }
  }

  #strike(note, { when, into, stop }) {
    const { context } = this.timebase;
    const source = new AudioBufferSourceNode(context, { buffer: this.#buffer(note) });
    const gain = new GainNode(context);
    gain.gain.setTargetAtTime(0, stop, DAMPER_SECS);
    source.connect(gain).connect(this.master);
    source.start(when, into);
    source.stop(stop + 6 * DAMPER_SECS);
    const voice = { source, gain };
    this.voices.add(voice);
    source.addEventListener('ended', () => {
      this.voices.delete(voice);
      gain.disconnect();
    });
    this.scheduled.push({ pitch: note.pitch, when, velocity: note.velocity });
  }

  #buffer({ pitch, velocity }) {
    const bucket = Math.min(127, Math.max(1, Math.round((velocity ?? 64) / VELOCITY_BUCKET) * VELOCITY_BUCKET));
    const key = pitch * 128 + bucket;
    if (!this.buffers.has(key)) {
      const samples = tone(pitch, bucket, this.longest);
      const buffer = new AudioBuffer({ length: samples.length, sampleRate: SAMPLE_RATE_HZ });
      buffer.copyToChannel(samples, 0);
      this.buffers.set(key, buffer);
    }
    return this.buffers.get(key);
  }

  /**
   * Computes tones when the page is idle, in the order of the notes; a tone that is not ready is
   * computed when it is played.
   */
  #prepare(notes) {
    const idle = window.requestIdleCallback ?? ((call) => setTimeout(call, 30));
    let index = 0;
    const one = () => {
      if (notes !== this.notes || index >= notes.length) return;
      this.#buffer(notes[index]);
      index += 1;
      idle(one);
    };
    idle(one);
  }

  #setGain() {
    const { context } = this.timebase;
    this.master?.gain.setTargetAtTime(this.muted ? 0 : HEADROOM * this.volume ** 2, context.currentTime, 0.01);
  }
}

/** The room as a node. */
function roomIn(context) {
  const samples = impulse(context.sampleRate);
  const buffer = new AudioBuffer({ length: samples.length, sampleRate: context.sampleRate });
  buffer.copyToChannel(samples, 0);
  return new ConvolverNode(context, { buffer, disableNormalization: true });
}
