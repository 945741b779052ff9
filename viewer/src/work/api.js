/** The server's API. Each call fails with an error message for the page. */

/** Largest MIDI file that the server accepts, bytes. */
const MAX_BYTES = 1 << 20;

async function jsonOf(request) {
  let response;
  try {
    response = await request;
  } catch {
    const offline = new Error('The server does not answer. Start `etude serve` again and open the address that it prints.');
    offline.isOffline = true;
    throw offline;
  }
  const value = await response.json();
  if (!response.ok) throw new Error(value.error);
  return value;
}

/** Songs, jobs, performances, comparisons and trainings. */
export const state = () => jsonOf(fetch('state'));

/** A song before anything runs. */
export const about = (song) => jsonOf(fetch(`song?name=${encodeURIComponent(song)}`));

/** A JSON file of the working folder. */
export const json = (path) => jsonOf(fetch(address(path)));

/** Starts a verb; gives the number of its job. */
export async function start(request) {
  const { id } = await jsonOf(fetch('jobs', { method: 'POST', body: JSON.stringify(request) }));
  return id;
}

/** Requests a job to stop. */
export const stop = (id) => jsonOf(fetch(`jobs/${id}/stop`, { method: 'POST' }));

/** Uploads a MIDI file; gives the path of the song. */
export async function upload(file) {
  if (file.size > MAX_BYTES) throw new Error(`${file.name} is larger than ${MAX_BYTES >> 20} MiB. Put it into the folder songs, and it is listed.`);
  const { song } = await jsonOf(fetch(`songs?name=${encodeURIComponent(file.name)}`, { method: 'POST', body: file }));
  return song;
}

/** The address of a file of the working folder. */
export function address(path) {
  return `files/${path.split('/').map(encodeURIComponent).join('/')}`;
}
