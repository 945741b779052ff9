/** The page of `etude serve`. All that it does is done by verbs of `etude`, and all that it shows lies in files; so a reload loses nothing. */

import { element, reveal, setText } from '../dom.js';
import * as ask from './ask.js';
import { comparison, comparisonsList, jobsList, performancesList, runs, trainingsList } from './lists.js';
import { Section, choice, field, notesText, playerText, scoreText } from './parts.js';
import { SongSection } from './song.js';

/** Time between two questions to the server while something runs, and while nothing does, ms. */
const SOON = 200;
const LATER = 1500;

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
const heard = element('section', { class: 'heard' }, element('h2', { text: 'What was played' }), heading, player);
heard.hidden = true;
const song = new SongSection((wanted) => start(wanted), (about) => read(about));
const jobs = new Section('Jobs');
const performances = new Section('Performances');
const comparisons = new Section('Comparisons');
const compared = new Section('Note by note');
const trainings = new Section('Trainings');

/** What to do when a job has come so far, and whether a person has asked for the job, by its number. */
const waiting = new Map();
/** Recordings that are marked for a comparison. */
const chosen = [];
let known = { songs: [], jobs: [], performances: [], comparisons: [], runs: [] };
/** Number of the last question for the state, so that a late answer to an earlier one is dropped. */
let asked = 0;
let timer;

document.getElementById('work').append(
  element('header', {}, element('h1', { text: 'Étude' }), folder),
  element(
    'main', {}, trouble, drop, field('Song', chooser), status, heard, song.root,
    jobs.root, performances.root, comparisons.root, compared.root, trainings.root,
  ),
);

function fail(error) {
  setText(trouble, error.message);
  trouble.dataset.gone = String(error.isGone === true);
}

/** Does something that a person has asked for; what goes wrong is said, and brought into view. */
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
async function begun(wanted, isAskedFor) {
  const id = await ask.start(wanted);
  waiting.set(id, { then: (job) => AFTER[wanted.verb]?.(job, wanted), isAskedFor });
  await look();
  return id;
}

/** Starts a verb that a person has asked for, and brings its job into view while it runs. */
const start = (wanted) => attempt(async () => {
  const id = await begun(wanted, true);
  if (known.jobs.some((job) => job.id === id && runs(job))) reveal(jobs.content.querySelector('li'));
});

const stop = (id) => attempt(async () => {
  await ask.stop(id);
  await look();
});

/** What follows the first step of a verb that this page has started. */
const AFTER = {
  // What was just read counts, whatever the times of its files are.
  show: (job, { song: shown }) => shown === song.song && song.choose(shown, false),
  arrange: (job) => choose(job.makes),
  play: hear,
  perform: hear,
  compare: (job) => showComparison(job.makes),
  replay: (_, { recording }) => {
    const { page } = known.performances.find((performance) => performance.recording === recording) ?? {};
    if (page) reveal(performances.content.querySelector(`[data-key="${CSS.escape(`page ${page}`)}"]`));
  },
};

/** Lets `etude songs show` read a song, or waits for it if it does so already. */
async function read({ song: name, about }) {
  const job = known.jobs.find((job) => job.makes === about && runs(job));
  if (job) waiting.set(job.id, { then: () => AFTER.show(job, { song: name }), isAskedFor: false });
  else await begun({ verb: 'show', song: name }, false);
}

function hear(job) {
  const performance = known.performances.find(({ recording }) => recording.startsWith(`${job.makes}/`));
  if (performance) return listen(performance);
  return undefined;
}

/** Plays the sound of a performance. */
async function listen(performance) {
  const figures = [notesText(performance), scoreText(performance.f1)].filter(Boolean).join(', ');
  heading.textContent = `${performance.song}, played by ${playerText(performance.player)}: ${figures}`;
  heard.hidden = false;
  reveal(heard);
  // The file of this name may be a new one.
  player.src = `${ask.address(performance.wav)}?at=${Date.now()}`;
  try {
    await player.play();
  } catch (error) {
    // A browser may want its button pressed first, and another sound may have been chosen.
    if (error.name !== 'NotAllowedError' && error.name !== 'AbortError') fail(new Error(`${performance.wav} cannot be played: ${error.message}`));
  }
}

/** Shows a song; the address keeps it, so that a reload shows it again. */
async function choose(name) {
  chooser.value = name;
  history.replaceState(null, '', `#${encodeURIComponent(name)}`);
  return song.choose(name);
}

async function showComparison(path) {
  const found = await ask.json(path);
  comparisons.content.querySelector('select').value = path;
  compared.show([path, found], () => comparison(path, found));
  reveal(compared.root);
}

/** Takes a MIDI file: shows it, and lets it be played if the keyboard has its notes. */
const take = (file) => attempt(async () => {
  status.textContent = `Reading ${file.name}…`;
  try {
    const name = await ask.handOver(file);
    await look();
    const { problem, policy } = await choose(name);
    if (problem === null) await start({ verb: 'play', song: name, player: policy === null ? 'scripted' : 'best' });
  } finally {
    status.textContent = '';
  }
});

/** Asks how things are, shows it, and asks again after a while. */
async function look() {
  clearTimeout(timer);
  asked += 1;
  const question = asked;
  try {
    const seen = await ask.state();
    if (question !== asked) return;
    known = seen;
    if (trouble.dataset.gone === 'true') fail(new Error(''));
    show();
    await follow();
  } catch (error) {
    fail(error);
  }
  if (question === asked) timer = setTimeout(look, known.jobs.some(runs) ? SOON : LATER);
}

/** Does what follows the jobs that have come so far. */
async function follow() {
  for (const job of known.jobs.filter(({ id }) => waiting.has(id))) {
    const { then, isAskedFor } = waiting.get(job.id);
    if (job.done > 0 || !runs(job)) waiting.delete(job.id);
    if (job.done > 0) await then(job);
    else if (job.state === 'stopped') status.textContent = `Stopped: ${job.title}`;
    else if (job.state === 'failed') {
      fail(new Error(`${job.title}: ${job.said.join('\n') || 'failed'}`));
      if (isAskedFor) reveal(trouble);
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
    [steady, known.songs, brief.map(({ id, makes, state }) => [id, makes, state])],
    () => trainingsList(steady, brief, { start, stop, songs: known.songs }),
  );
}

chooser.addEventListener('change', () => attempt(() => choose(chooser.value)));
input.addEventListener('change', () => {
  const [file] = input.files;
  if (file) take(file);
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
  if (file) take(file);
  else fail(new Error('Drop a MIDI file, which ends in .mid.'));
});

// One sound at a time.
document.addEventListener('play', ({ target }) => {
  document.querySelectorAll('audio').forEach((other) => other !== target && other.pause());
}, true);

/** Shows how things are, and the song that the address names. */
async function begin() {
  jobs.show([], () => null);
  compared.show(null, () => null);
  await look();
  try {
    const wanted = decodeURIComponent(location.hash.slice(1));
    const [first] = known.songs;
    if (first) await choose(known.songs.some(({ song: name }) => name === wanted) ? wanted : first.song);
  } catch (error) {
    fail(error);
  }
}

begin();
