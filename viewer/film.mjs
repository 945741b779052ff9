/** The moving picture of the README: node film.mjs REPLAY.html SOUND.wav OUT writes OUT.webp, and OUT.mp4 with the sound. Needs ffmpeg. */

import { execFileSync } from 'node:child_process';
import { mkdtemp, rm } from 'node:fs/promises';
import os from 'node:os';
import path from 'node:path';

import { launch, ready } from './test/browser.mjs';

const FPS = 15;
const [replay, sound, out] = process.argv.slice(2);

const folder = await mkdtemp(path.join(os.tmpdir(), 'etude-film-'));
const browser = await launch();
const page = await browser.open(path.resolve(replay), { width: 800, height: 700 });
await ready(page);
await page.evaluate(() => document.querySelector('.begin').remove());
const crop = async (part) => {
  const { x, y, width, height } = await page.locator(part).boundingBox();
  // The video's size must be even.
  return `crop=${[width, height, x, y].map((value) => 2 * Math.round(value / 2)).join(':')}`;
};
// The scene above the piano roll, without the buttons between them.
const parts = `[0]split[a][b];[a]${await crop('.pane')}[scene];[b]${await crop('.roll')}[roll];[scene][roll]vstack`;
const secs = await page.evaluate(() => window.etude.duration());
for (let frame = 0; frame < secs * FPS; frame += 1) {
  await page.evaluate((at) => {
    window.etude.seek(at);
    return new Promise((drawn) => { requestAnimationFrame(() => requestAnimationFrame(drawn)); });
  }, frame / FPS);
  await page.screenshot({ fullPage: true, path: path.join(folder, `${String(frame).padStart(5, '0')}.png`) });
}
await browser.close();

const frames = ['-v', 'error', '-y', '-framerate', String(FPS), '-i', path.join(folder, '%05d.png')];
execFileSync('ffmpeg', [...frames, '-filter_complex', `${parts},fps=10,scale=640:-2`,
  '-c:v', 'libwebp_anim', '-quality', '55', '-loop', '0', `${out}.webp`]);
execFileSync('ffmpeg', [...frames, '-i', sound, '-filter_complex', `${parts},format=yuv420p[film]`, '-map', '[film]', '-map', '1:a',
  '-c:v', 'libx264', '-crf', '26', '-preset', 'slow', '-c:a', 'aac', '-b:a', '96k', '-movflags', '+faststart', `${out}.mp4`]);
await rm(folder, { recursive: true, force: true });
