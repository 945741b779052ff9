/**
 * Every page in Chromium, light and dark, wide and on a phone: axe-core finds nothing, no error is told, the page does not scroll
 * sideways, and what it links to is there. `ETUDE_PAGES` names the pages, separated as in PATH; without it, replay pages of made-up takes.
 * `ETUDE_SCREENSHOTS` names the folder for screenshots.
 */

import assert from 'node:assert/strict';
import { access, mkdir, readFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import os from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath, pathToFileURL } from 'node:url';

import { launch, ready } from './browser.mjs';
import { oneTake, twoTakes } from './sample.mjs';

const LOOKS = [
  ['wide', { width: 1280, height: 800 }],
  ['phone', { width: 390, height: 844, touch: true }],
].flatMap(([name, size]) => [[`${name}-light`, size], [`${name}-dark`, { ...size, dark: true }]]);
const screenshots = process.env.ETUDE_SCREENSHOTS ?? os.tmpdir();

/** Name of each page, and how its file is made. */
const pages = process.env.ETUDE_PAGES?.split(path.delimiter).map((file) => [path.basename(file, '.html'), () => file])
  ?? [['one', () => browser.write(oneTake())], ['two', () => browser.write(twoTakes())]];

let axe;
let browser;

before(async () => {
  await mkdir(screenshots, { recursive: true });
  axe = await readFile(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
  browser = await launch();
});

after(() => browser?.close());

/** What axe-core finds, a line an element. */
async function violations(page) {
  await page.evaluate(axe);
  // Nothing is fetched again for the test: the page's policy would forbid it, and its styles are in it.
  const found = await page.evaluate(() => window.axe.run({ preload: false }));
  return found.violations.flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.target} ${node.failureSummary}`));
}

for (const [index, [name, make]] of pages.entries()) {
  for (const [look, options] of LOOKS) {
    test(`${name} is accessible and whole: ${look}`, async () => {
      const file = await make();
      const page = await browser.open(file, options);
      const folder = pathToFileURL(path.dirname(file)).href;
      try {
        if (await page.locator('#replay').count()) await ready(page);
        await page.evaluate(async () => {
          document.querySelectorAll('details').forEach((details) => { details.open = true; });
          const pictures = [...document.querySelectorAll('img')];
          pictures.forEach((picture) => { picture.loading = 'eager'; });
          await Promise.all(pictures.map((picture) => picture.decode()));
        });
        assert.deepEqual(await violations(page), []);
        assert.ok((await page.evaluate(() => document.scrollingElement.scrollWidth - window.innerWidth)) <= 0, 'no sideways scrolling');
        const links = await page.evaluate(() => [...document.querySelectorAll('[href], [src]')].map((link) => link.href || link.src));
        for (const link of links.filter((address) => address.startsWith('file:'))) await access(fileURLToPath(link));
        await page.screenshot({ path: path.join(screenshots, `${index + 1}-${name}-${look}.png`), fullPage: true });
        assert.deepEqual(page.troubles, []);
        assert.deepEqual(page.requests.filter((address) => !address.startsWith(folder)), []);
      } finally {
        await page.context().close();
      }
    });
  }
}
