/** The lists of jobs, performances, comparisons and trainings. */

import { strokeText } from '../classify.js';
import { element, pitchName } from '../dom.js';
import * as api from './api.js';
import { curve, stepsText } from './curve.js';
import { button, choice, field, notesText, playerText, scoreText, table, timeText } from './parts.js';

/** Whether a job has not ended. */
export const runs = (job) => job.state === 'running' || job.state === 'stopping';

/** Names of the states. */
const STATES = {
  running: 'running', stopping: 'stopping and saving', done: 'done', stopped: 'stopped', failed: 'failed',
  waiting: 'without a step yet', silent: 'stopped', finished: 'finished',
};

/** Ended jobs that are shown. */
const MAX_ENDED = 3;

/** Jobs that run, and the last ones that failed or were stopped. */
export function jobsList(jobs, { stop }) {
  const ended = jobs.filter((job) => !runs(job) && job.state !== 'done').slice(0, MAX_ENDED);
  const shown = [...jobs.filter(runs), ...ended];
  if (shown.length === 0) return null;
  const item = (job) => element(
    'li', { class: job.state },
    element(
      'p', { class: 'row' },
      element('strong', { text: job.title }), element('span', { class: 'quiet', text: STATES[job.state] }),
      runs(job) ? button('Stop', `stop${job.id}`, () => stop(job.id), { disabled: job.state === 'stopping', 'aria-label': `Stop: ${job.title}` }) : null,
    ),
    element('p', {}, element('code', { text: job.command })),
    job.log.length > 0 ? element('p', { class: job.state === 'failed' ? 'problem' : 'note', text: job.log.join('\n') }) : null,
  );
  return [element('ul', { class: 'jobs' }, ...shown.map(item))];
}

/** Performances with sound, replay and comparison. */
export function performancesList(performances, { listen, start, chosen }) {
  if (performances.length === 0) return null;
  const compare = button('Compare the two that are marked', 'compare', () => start({ verb: 'compare', one: chosen[0], other: chosen[1] }));
  const hint = element('span', { class: 'quiet', text: 'mark two performances of one song' });
  const enable = () => {
    const songs = chosen.map((marked) => performances.find(({ recording }) => recording === marked)?.song);
    hint.hidden = songs.length === 2 && songs[0] === songs[1];
    compare.disabled = !hint.hidden;
  };
  const mark = (performance) => {
    const box = element('input', { type: 'checkbox', 'data-key': `mark ${performance.recording}`, 'aria-label': `Compare ${performance.recording}` });
    box.checked = chosen.includes(performance.recording);
    box.addEventListener('change', () => {
      if (box.checked) chosen.push(performance.recording);
      else chosen.splice(chosen.indexOf(performance.recording), 1);
      enable();
    });
    return box;
  };
  const item = (performance) => element(
    'li', {},
    element(
      'div', { class: 'what' }, element('strong', { text: performance.song }),
      element('p', { class: 'quiet', text: `${performance.mode === null ? 'simulation' : `twin, ${performance.mode}`}, by ${playerText(performance.player)}` }),
    ),
    element('span', { class: 'result', text: [notesText(performance), scoreText(performance.f1)].filter(Boolean).join(', ') }),
    element(
      'div', { class: 'acts' },
      element('label', {}, mark(performance), 'compare'),
      button('Listen', `listen ${performance.recording}`, () => listen(performance), { 'aria-label': `Listen to ${performance.recording}` }),
      performance.page === null
        ? button('Make the replay', `replay ${performance.recording}`, () => start({ verb: 'replay', recording: performance.recording }))
        : replayLink(performance.page, performance.recording),
    ),
  );
  enable();
  return [
    element('ul', { class: 'performances' }, ...performances.map(item)),
    element('p', { class: 'row' }, compare, hint),
  ];
}

/** A link to a replay, which opens in a new tab. */
export function replayLink(page, name) {
  return element('a', { href: api.address(page), target: '_blank', rel: 'noopener', text: 'Replay', 'data-key': `page ${page}`, 'aria-label': `Replay of ${name}` });
}

/** The comparisons, to choose one. */
export function comparisonsList(paths, choose) {
  if (paths.length === 0) return null;
  const name = (path) => path.split('/').at(-1).replace(/\.json$/, '').replace('_', ' and ');
  const choices = choice([['', 'choose one'], ...paths.map((path) => [path, name(path)])], { 'data-key': 'comparison' });
  choices.addEventListener('change', () => choices.value && choose(choices.value));
  return [field('Comparison', choices)];
}

/** The rows of a comparison in order of time: the due notes and the wrong strokes. */
export function comparedRows({ notes, strays }) {
  const played = (stroke) => strokeText(stroke && {
    onset: stroke.onset_error_secs, length: stroke.length_error_secs, velocity: stroke.velocity, right: stroke.right,
  });
  const due = notes.map((note) => ({ secs: note.due_secs, cells: [note.name, ...note.played.map(played)] }));
  const wrong = strays.flatMap((strokes, side) => strokes.map(({ pitch, start, end, velocity }) => {
    const text = `wrong stroke, ${Math.round((end - start) * 1e3)}, ${velocity}`;
    return { secs: start, cells: [pitchName(pitch), side === 0 ? text : '', side === 1 ? text : ''] };
  }));
  const all = [...due, ...wrong].sort((one, other) => one.secs - other.secs);
  return all.map(({ secs, cells }) => [`${secs.toFixed(2)} s`, ...cells]);
}

/** The output of `etude compare`. */
export function comparison(path, compared) {
  const sides = ['a', 'b'].map((side) => compared[side]);
  const songs = sides[0].song === sides[1].song ? sides[0].song : `${sides[0].song} (A) and ${sides[1].song} (B), which have the same notes`;
  return [
    element('p', {}, `${songs}. `, replayLink(path.replace(/\.json$/, '.html'), 'both performances')),
    element('ul', {}, ...sides.map(({ name, player, notes, frames }, index) => {
      const due = notes && { notes_right: notes.matched, notes_due: notes.matched + notes.missed, notes_wrong: notes.wrong };
      const figures = [due && notesText(due), scoreText(frames?.f1)].filter(Boolean).join(', ');
      return element('li', { text: `${'AB'[index]}: ${name}, by ${playerText(player)}: ${figures}` });
    })),
    element('p', { class: 'note', text: 'Of each note: onset and length, played minus due, in ms, and velocity. In the scores a note more than 50 ms early or late counts as missed, and its stroke as wrong. Of a wrong stroke: how long its key was held, in ms, and velocity.' }),
    table('Note by note', ['at', 'note', 'A', 'B'], comparedRows(compared)),
  ];
}

/** Trainings with their curves. */
export function trainingsList(trainings, jobs, { start, stop, songs }) {
  if (trainings.length === 0) return null;
  const cards = trainings.map((run) => {
    const job = jobs.find((job) => job.output === run.run && runs(job));
    // A training that has logged lately and is no job of this server may belong to another process.
    const rest = run.state !== 'running' ? STATES[run.state] : jobs.some(({ output }) => output === run.run) ? 'stopped' : 'stopped, or running elsewhere';
    const state = job ? STATES[job.state] : rest;
    const song = songs.find(({ title }) => title === run.song)?.song;
    const left = Math.min(run.secs_left ?? Infinity, job?.secs_left ?? Infinity);
    const figures = [
      `${stepsText(run.step)} of ${stepsText(run.total_steps ?? run.step)} control steps`,
      `${timeText(run.secs)} trained`,
      job && Number.isFinite(left) ? `${timeText(left)} left` : '',
      notesText(run),
      run.best_f1 === null ? '' : `best ${scoreText(run.best_f1)}`,
    ].filter(Boolean);
    return element(
      'article', { class: 'card' },
      element('h3', { text: run.name }),
      element('p', {}, `${run.song ?? ''}: `, element('strong', { text: state })),
      element('p', { class: 'quiet', text: figures.join('; ') }),
      curve('F1', run.f1, [0, 1], run.total_steps),
      curve('Reward per step', run.reward_curve, null, run.total_steps),
      element(
        'p', { class: 'row' },
        job
          ? button('Stop and save', `stop ${run.run}`, () => stop(job.id), { disabled: job.state === 'stopping', 'aria-label': `Stop and save: ${run.name}` })
          : button('Resume training', `resume ${run.run}`, () => start({ verb: 'resume', run: run.run, minutes: null }), { 'aria-label': `Resume training: ${run.name}` }),
        song !== undefined && run.best_f1 !== null
          ? button('Play its best policy', `play ${run.run}`, () => start({ verb: 'play', song, player: { run: run.run } }), { 'aria-label': `Play its best policy: ${run.name}` })
          : null,
      ),
    );
  });
  return [element('div', { class: 'cards' }, ...cards)];
}
