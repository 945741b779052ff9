/**
 * How fast a replay page is: plays ten seconds in Chromium drawn by software and prints what it measured as JSON.
 *
 *     node bench.mjs [PAGE.html]      (default: a made-up take, then two of them side by side)
 */

import { launch, ready } from './test/browser.mjs';
import { oneTake, twoTakes } from './test/sample.mjs';

const PLAYED_MS = 10_000;

const browser = await launch();
try {
  const given = process.argv[2];
  const pages = given ? { [given]: given } : { 'one take': await browser.write(oneTake()), 'two takes': await browser.write(twoTakes()) };
  for (const [name, file] of Object.entries(pages)) {
    const page = await browser.open(file);
    await ready(page);
    await page.evaluate(() => window.etude.play());
    await page.waitForTimeout(PLAYED_MS);
    const measured = await page.evaluate(() => ({ first_frame_ms: Math.round(window.etude.readyMs()), fps: Math.round(window.etude.fps() * 10) / 10 }));
    console.log(JSON.stringify({ page: name, ...measured }));
    await page.close();
  }
} finally {
  await browser.close();
}
