/** Questions to the server of the page. Each fails with an error in words. */

/** Largest MIDI file that the server takes, bytes. */
const LARGEST = 1 << 20;

async function answered(asked) {
  let answer;
  try {
    answer = await asked;
  } catch {
    const gone = new Error('The server does not answer. Start `etude serve` again and open the address that it prints.');
    gone.isGone = true;
    throw gone;
  }
  const value = await answer.json();
  if (!answer.ok) throw new Error(value.error);
  return value;
}

/** What runs and what there is. */
export const state = () => answered(fetch('state'));

/** What is known of a song. */
export const about = (song) => answered(fetch(`song?name=${encodeURIComponent(song)}`));

/** A JSON file of the working folder. */
export const json = (path) => answered(fetch(address(path)));

/** Starts a verb; gives the number of its job. */
export async function start(wanted) {
  const { id } = await answered(fetch('jobs', { method: 'POST', body: JSON.stringify(wanted) }));
  return id;
}

/** Asks a job to stop. */
export const stop = (id) => answered(fetch(`jobs/${id}/stop`, { method: 'POST' }));

/** Hands a MIDI file over; gives the name of the song. */
export async function handOver(file) {
  if (file.size > LARGEST) throw new Error(`${file.name} is larger than ${LARGEST >> 20} MiB. Put it into the folder songs, and it is listed.`);
  const { song } = await answered(fetch(`songs?name=${encodeURIComponent(file.name)}`, { method: 'POST', body: file }));
  return song;
}

/** Where a file of the working folder is on this server. */
export function address(path) {
  return `files/${path.split('/').map(encodeURIComponent).join('/')}`;
}
