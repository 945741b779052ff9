/** The picture of the replay page in the README: node picture.mjs REPLAY.html SECS OUT.png */

import path from 'node:path';

import { launch, ready } from './test/browser.mjs';

const [replay, secs, out] = process.argv.slice(2);

const browser = await launch();
const page = await browser.open(path.resolve(replay), { width: 1280, height: 900 });
await ready(page);
await page.evaluate((at) => {
  document.querySelector('.begin').remove();
  window.etude.seek(at);
  return new Promise((drawn) => { requestAnimationFrame(() => requestAnimationFrame(drawn)); });
}, Number(secs));
await page.screenshot({ path: path.resolve(out) });
await browser.close();
