/**
 * The page of `etude serve`. Its buttons run verbs of `etude`, and all that it shows is in files;
 * so a reload loses nothing.
 */

import { element, reveal, setText } from '../dom.js';
import * as api from './api.js';
import { comparison, comparisonsList, jobsList, performancesList, runs, trainingsList } from './lists.js';
import { Section, choice, field, notesText, playerText, scoreText } from './parts.js';
import { SongSection } from './song.js';

/** Time between two requests of the state while a job runs, and otherwise, ms. */
const POLL_INTERVAL_BUSY = 200;
const POLL_INTERVAL_IDLE = 1500;

const trouble = element('p', { class: 'trouble', role: 'alert' });
const status = element('p', { class: 'note', role: 'status' });
const folder = element('span', { class: 'brand' });
const chooser = choice([], {});
const input = element('input', { type: 'file', accept: '.mid,.midi,audio/midi' });
const drop = element(
  'div', { class: 'drop' },
  element('p', { text: 'Drop a MIDI file here to hear the robot hand play it.' }),
  element('label', { class: 'file' }, 'Choose a MIDI file', input),
);
const player = element('audio', { controls: true, preload: 'metadata', id: 'player', 'aria-label': 'The performance' });
const heading = element('p', {});
const playback = element('section', { class: 'playback' }, element('h2', { text: 'Performance' }), heading, player);
playback.hidden = true;
const song = new SongSection((request) => start(request), (about) => analyse(about));
const jobs = new Section('Jobs');
const performances = new Section('Performances');
const comparisons = new Section('Comparisons');
const compared = new Section('Note by note');
const trainings = new Section('Trainings');

/** By a job's number: what follows its first step, and whether the user has requested it. */
const waiting = new Map();
/** Recordings that are marked for a comparison. */
const chosen = [];
let known = { songs: [], jobs: [], performances: [], comparisons: [], runs: [] };
/** Number of the last request of the state: a late response to an older one is dropped. */
let requests = 0;
let timer;

document.getElementById('work').append(
  element('header', {}, element('h1', { text: 'Étude' }), folder),
  element(
    'main', {}, trouble, drop, field('Song', chooser), status, playback, song.root,
    jobs.root, performances.root, comparisons.root, compared.root, trainings.root,
  ),
);

function fail(error) {
  setText(trouble, error.message);
  trouble.dataset.offline = String(error.isOffline === true);
}

/** Does something that the user has requested; shows an error. */
async function attempt(act) {
  try {
    trouble.textContent = '';
    await act();
  } catch (error) {
    fail(error);
    reveal(trouble);
  }
}

/** Starts a verb; gives the number of its job. */
async function startJob(request, isUserRequest) {
  const id = await api.start(request);
  waiting.set(id, { then: (job) => AFTER[request.verb]?.(job, request), isUserRequest });
  await poll();
  return id;
}

/** Starts a verb that the user has requested, and scrolls to its job while it runs. */
const start = (request) => attempt(async () => {
  const id = await startJob(request, true);
  if (known.jobs.some((job) => job.id === id && runs(job))) reveal(jobs.content.querySelector('li'));
});

const stop = (id) => attempt(async () => {
  await api.stop(id);
  await poll();
});

/** What follows the first step of a verb. */
const AFTER = {
  // The new output is shown, whatever the times of its files are.
  show: (job, { song: shown }) => shown === song.song && song.choose(shown, false),
  arrange: (job) => choose(job.output),
  play: listenTo,
  perform: listenTo,
  compare: (job) => showComparison(job.output),
  replay: (_, { recording }) => {
    const { page } = known.performances.find((performance) => performance.recording === recording) ?? {};
    if (page) reveal(performances.content.querySelector(`[data-key="${CSS.escape(`page ${page}`)}"]`));
  },
};

/** Runs `etude songs show` on a song, or waits for it if it is running. */
async function analyse({ song: name, about }) {
  const job = known.jobs.find((job) => job.output === about && runs(job));
  if (job) waiting.set(job.id, { then: () => AFTER.show(job, { song: name }), isUserRequest: false });
  else await startJob({ verb: 'show', song: name }, false);
}

function listenTo(job) {
  const performance = known.performances.find(({ recording }) => recording.startsWith(`${job.output}/`));
  if (performance) return listen(performance);
  return undefined;
}

/** Plays the sound of a performance. */
async function listen(performance) {
  const figures = [notesText(performance), scoreText(performance.f1)].filter(Boolean).join(', ');
  heading.textContent = `${performance.song}, played by ${playerText(performance.player)}: ${figures}`;
  playback.hidden = false;
  reveal(playback);
  // The file may have been replaced.
  player.src = `${api.address(performance.wav)}?at=${Date.now()}`;
  try {
    await player.play();
  } catch (error) {
    // A browser may require a click first, and another sound may have been chosen.
    if (error.name !== 'NotAllowedError' && error.name !== 'AbortError') fail(new Error(`${performance.wav} cannot be played: ${error.message}`));
  }
}

/** Shows a song and puts it into the address, for a reload. */
async function choose(name) {
  chooser.value = name;
  history.replaceState(null, '', `#${encodeURIComponent(name)}`);
  return song.choose(name);
}

async function showComparison(path) {
  const found = await api.json(path);
  comparisons.content.querySelector('select').value = path;
  compared.show([path, found], () => comparison(path, found));
  reveal(compared.root);
}

/** Uploads a MIDI file, shows it, and plays it if the keyboard has its notes. */
const upload = (file) => attempt(async () => {
  status.textContent = `Reading ${file.name}…`;
  try {
    const name = await api.upload(file);
    await poll();
    const { problem, policy } = await choose(name);
    if (problem === null) await start({ verb: 'play', song: name, player: policy === null ? 'scripted' : 'best' });
  } finally {
    status.textContent = '';
  }
});

/** Requests the state, shows it, and repeats this after a while. */
async function poll() {
  clearTimeout(timer);
  requests += 1;
  const number = requests;
  try {
    const state = await api.state();
    if (number !== requests) return;
    known = state;
    if (trouble.dataset.offline === 'true') fail(new Error(''));
    show();
    await follow();
  } catch (error) {
    fail(error);
  }
  if (number === requests) timer = setTimeout(poll, known.jobs.some(runs) ? POLL_INTERVAL_BUSY : POLL_INTERVAL_IDLE);
}

/** Does what follows the first steps of the jobs. */
async function follow() {
  for (const job of known.jobs.filter(({ id }) => waiting.has(id))) {
    const { then, isUserRequest } = waiting.get(job.id);
    if (job.steps_done > 0 || !runs(job)) waiting.delete(job.id);
    if (job.steps_done > 0) await then(job);
    else if (job.state === 'stopped') status.textContent = `Stopped: ${job.title}`;
    else if (job.state === 'failed') {
      fail(new Error(`${job.title}: ${job.log.join('\n') || 'failed'}`));
      if (isUserRequest) reveal(trouble);
    }
  }
}

function show() {
  folder.textContent = known.folder;
  const names = JSON.stringify(known.songs);
  if (names !== chooser.dataset.songs) {
    chooser.dataset.songs = names;
    const { value } = chooser;
    const options = known.songs.map(({ song: name, title }) => element('option', { value: name, text: name === title ? title : `${title} (${name})` }));
    chooser.replaceChildren(...options);
    chooser.value = value;
  }
  for (let index = chosen.length - 1; index >= 0; index -= 1) {
    if (!known.performances.some(({ recording }) => recording === chosen[index])) chosen.splice(index, 1);
  }
  const brief = known.jobs.map(({ secs, ...job }) => job);
  jobs.show(brief, () => jobsList(brief, { stop }));
  performances.show(known.performances, () => performancesList(known.performances, { listen, start, chosen }));
  comparisons.show(known.comparisons, () => comparisonsList(known.comparisons, (path) => attempt(() => showComparison(path))));
  const steady = known.runs.map(({ secs_since_written: _, ...run }) => run);
  trainings.show(
    [steady, known.songs, brief.map(({ id, output, state }) => [id, output, state])],
    () => trainingsList(steady, brief, { start, stop, songs: known.songs }),
  );
}

chooser.addEventListener('change', () => attempt(() => choose(chooser.value)));
input.addEventListener('change', () => {
  const [file] = input.files;
  if (file) upload(file);
  // The same file can be chosen again.
  input.value = '';
});

// A file may be dropped anywhere; elsewhere the browser would open it in place of the page.
for (const event of ['dragenter', 'dragover']) {
  document.addEventListener(event, (drag) => {
    drag.preventDefault();
    drop.classList.add('over');
  });
}
document.addEventListener('dragleave', (drag) => drag.relatedTarget === null && drop.classList.remove('over'));
document.addEventListener('drop', (dropped) => {
  dropped.preventDefault();
  drop.classList.remove('over');
  const [file] = dropped.dataTransfer.files;
  if (file) upload(file);
  else fail(new Error('Drop a MIDI file, which ends in .mid.'));
});

// One sound at a time.
document.addEventListener('play', ({ target }) => {
  document.querySelectorAll('audio').forEach((other) => other !== target && other.pause());
}, true);

/** Shows the state, and the song in the address. */
async function begin() {
  jobs.show([], () => null);
  compared.show(null, () => null);
  await poll();
  try {
    const named = decodeURIComponent(location.hash.slice(1));
    const [first] = known.songs;
    if (first) await choose(known.songs.some(({ song: name }) => name === named) ? named : first.song);
  } catch (error) {
    fail(error);
  }
}

begin();
