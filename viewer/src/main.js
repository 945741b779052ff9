/** Entry point: reads the recordings from the document and shows them. */

import { element } from './dom.js';
import { Page } from './page.js';
import { Take } from './take.js';

const root = document.getElementById('replay');

function start() {
  let data;
  try {
    data = JSON.parse(document.getElementById('data').textContent);
  } catch (error) {
    return say(`This page's recording cannot be read: ${error.message}`);
  }
  if (data?.version !== 1) return say('This page has a recording of another version. Make it again with etude replay.');
  const takes = (data.takes ?? []).map((take) => new Take(take));
  if (takes.length === 0) return say('This page has no recording.');
  return expose(new Page(root, takes, data.differences ?? []));
}

function say(text) {
  root.append(element('p', { class: 'failure', role: 'alert', text }));
}

/** Functions for tests and for the console. */
function expose(page) {
  const { player } = page;
  window.etude = {
    time: () => player.time(),
    duration: () => player.duration,
    seek: (secs) => page.seek(secs),
    play: () => page.play(),
    pause: () => player.pause(),
    playing: () => player.playing,
    setSpeed: (speed) => player.setSpeed(speed),
    setCamera: (name) => page.setCamera(name),
    camera: () => page.cameras.view.name,
    loop: () => player.loop,
    keysDown: (pane) => page.panes[pane].stage.keysDown(),
    keyNames: (pane) => page.panes[pane].stage.labels.map(({ name }) => name),
    keysShown: (pane) => page.panes[pane].stage.keysShown(),
    scheduled: () => page.sound.scheduled,
    fps: () => page.quality.fps(),
    readyMs: () => page.readyMs,
  };
}

start();
