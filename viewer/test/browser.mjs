/** Opening a replay page in Chromium, and what to watch while it is open. */

import { mkdtemp, readFile, rm, writeFile } from 'node:fs/promises';
import os from 'node:os';
import path from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

import { chromium } from 'playwright-core';

const dist = path.join(path.dirname(fileURLToPath(import.meta.url)), '..', 'dist');

/** How Chromium is started. */
export const FLAGS = [
  '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--disable-gpu', '--enable-unsafe-swiftshader', '--autoplay-policy=no-user-gesture-required',
];

/** The page that `etude replay` writes for this data. */
export async function pageOf(data) {
  const part = (name) => readFile(path.join(dist, name), 'utf8');
  const [script, style, policy] = await Promise.all(['replay.js', 'replay.css', 'csp.txt'].map(part));
  const json = JSON.stringify(data).replaceAll('<', '\\u003c');
  return `<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"/><meta http-equiv="Content-Security-Policy" content="${policy}"/>`
    + '<meta name="viewport" content="width=device-width, initial-scale=1"/><title>Étude replay</title>'
    + `<style>${style}</style></head><body><noscript>This page needs JavaScript.</noscript><div id="replay"></div>`
    + `<script type="application/json" id="data">${json}</script><script>${script}</script></body></html>`;
}

/** Chromium with a folder for pages; `close` ends both. */
export async function launch() {
  const folder = await mkdtemp(path.join(os.tmpdir(), 'etude-replay-'));
  const browser = await chromium.launch({ executablePath: process.env.ETUDE_CHROMIUM ?? '/usr/bin/chromium', args: FLAGS });
  let pages = 0;
  return {
    /** Writes data as a page and gives its path. */
    async write(data) {
      pages += 1;
      const file = path.join(folder, `replay-${pages}.html`);
      await writeFile(file, await pageOf(data));
      return file;
    },
    /**
     * Opens a page file and waits for its first picture. What goes wrong collects in `page.troubles`, what is asked
     * of the network in `page.requests`.
     */
    async open(file, { width = 1280, height = 720, dark = false, touch = false } = {}) {
      const context = await browser.newContext({
        viewport: { width, height }, colorScheme: dark ? 'dark' : 'light', hasTouch: touch, isMobile: touch, offline: true,
        // A colour on its way to another one is neither.
        reducedMotion: 'reduce',
      });
      const page = await context.newPage();
      const address = pathToFileURL(file).href;
      page.troubles = [];
      page.requests = [];
      // Taking a picture of a canvas that the processor draws makes its driver talk; that is none of the page's doing.
      const ofPage = (message) => ['error', 'warning'].includes(message.type()) && !message.text().includes('GL Driver Message');
      page.on('console', (message) => ofPage(message) && page.troubles.push(message.text()));
      page.on('pageerror', (error) => page.troubles.push(String(error)));
      page.on('request', (request) => request.url() !== address && page.requests.push(request.url()));
      await page.goto(address);
      return page;
    },
    async close() {
      await browser.close();
      await rm(folder, { recursive: true, force: true });
    },
  };
}

/** Waits for the first drawn frame. */
export function ready(page) {
  return page.waitForFunction(() => window.etude?.readyMs() > 0, null, { timeout: 60000 });
}
