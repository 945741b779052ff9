/** When notes sound: conversion between song time and sound time. */

/**
 * Index of the first note that is not over at `secs`. Notes are sorted by their start, so the ones
 * before may be longer.
 */
export function firstUnfinished(notes, secs) {
  const index = notes.findIndex((note) => note.end > secs);
  return index < 0 ? notes.length : index;
}

/**
 * The times at which a note is to be played.
 * @param {{start: number, end: number}} note in song time
 * @param {{song: number, sound: number, speed: number}} anchor song time `song` is heard at sound
 *   time `sound`
 * @param {number} now sound time before which nothing can be scheduled any more
 * @param {number} until song time at which the music stops: the end of a loop
 * @returns {{when: number, into: number, stop: number} | null} sound times of start and end, and
 *   where in the tone to begin when its start is past; null for a note that would be over
 */
export function strikeOf(note, anchor, now, until = Infinity) {
  const soundOf = (song) => anchor.sound + (song - anchor.song) / anchor.speed;
  const start = soundOf(note.start);
  const stop = soundOf(Math.min(note.end, until));
  const when = Math.max(start, now);
  return stop > when ? { when, into: when - start, stop } : null;
}
