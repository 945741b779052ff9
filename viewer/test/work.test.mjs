/**
 * The page of `etude serve` in Chromium, from the drop of a MIDI file to the sound, and on to a training, the twin, a comparison and a
 * replay. `ETUDE_PAGE` is its address, `ETUDE_SONG` an unseen MIDI file, `ETUDE_SETTINGS` are settings with which a training takes a second.
 */

import assert from 'node:assert/strict';
import { mkdir, readFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import os from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';

import { chromium } from 'playwright-core';

import { FLAGS, ready } from './browser.mjs';

const { ETUDE_PAGE: address, ETUDE_SONG: songFile, ETUDE_SETTINGS: settings } = process.env;
const skip = address ? false : 'it is run by `cargo test --test command serve`, with a server';
const screenshots = process.env.ETUDE_SCREENSHOTS ?? os.tmpdir();
const LONG = { timeout: 120000 };

let browser;
let page;
const troubles = [];

async function open(options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, reducedMotion: 'reduce', ...options });
  const made = await context.newPage();
  made.on('console', (message) => ['error', 'warning'].includes(message.type()) && troubles.push(message.text()));
  made.on('pageerror', (error) => troubles.push(String(error)));
  await made.goto(address);
  return made;
}

before(async () => {
  if (skip) return;
  await mkdir(screenshots, { recursive: true });
  browser = await chromium.launch({ executablePath: process.env.ETUDE_CHROMIUM ?? '/usr/bin/chromium', args: FLAGS });
  page = await open();
});

after(() => browser?.close());

/** Drops a file on the page as a desktop does: these bytes, or so many zeros. */
async function dropOn(name, bytes) {
  const data = await page.evaluateHandle(([file, content]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([new Uint8Array(content)], file, { type: 'audio/midi' }));
    return transfer;
  }, [name, typeof bytes === 'number' ? bytes : [...bytes]]);
  for (const event of ['dragenter', 'dragover', 'drop']) await page.dispatchEvent('.drop', event, { dataTransfer: data });
}

/** A MIDI file of notes, each [pitch, start, length], in quarters of a beat of half a second. */
function midi(notes) {
  const events = notes.flatMap(([pitch, start, length]) => [[start, 0x90, pitch, 80], [start + length, 0x80, pitch, 0]]);
  events.sort(([one, first], [other, second]) => one - other || first - second);
  const track = events.flatMap(([at, ...event], index) => {
    const ticks = (at - (index > 0 ? events[index - 1][0] : 0)) * 24;
    return [0x80 | (ticks >> 7), ticks & 0x7f, ...event];
  });
  track.push(0, 0xff, 0x2f, 0);
  return [...Buffer.from('MThd'), 0, 0, 0, 6, 0, 0, 0, 1, 0, 96, ...Buffer.from('MTrk'), 0, 0, track.length >> 8, track.length & 0xff, ...track];
}

/** The loudest sample of the sound that an element plays, decoded from what the server sends. */
function loudest(selector) {
  return page.evaluate(async (which) => {
    const sound = await (await fetch(document.querySelector(which).currentSrc)).arrayBuffer();
    const decoded = await new AudioContext().decodeAudioData(sound);
    return decoded.getChannelData(0).reduce((most, sample) => Math.max(most, Math.abs(sample)), 0);
  }, selector);
}

const isDone = (text) => page.waitForFunction((wanted) => document.body.innerText.includes(wanted), text, LONG);

test('a dropped MIDI file is heard', { skip }, async () => {
  await page.getByText('As written').waitFor(LONG);
  const begun = Date.now();
  await dropOn(path.basename(songFile), await readFile(songFile));
  await page.waitForFunction(() => {
    const player = document.getElementById('player');
    return !player.paused && player.currentTime > 0;
  }, null, LONG);
  console.log(`from the drop to the sound: ${((Date.now() - begun) / 1000).toFixed(2)} s`);
  assert.match(await page.locator('.playback').innerText(), /played by the policy policies\/sight-reader\.safetensors: \d+ of 44 notes right/);
  assert.match(await page.locator('.song').innerText(), /No policy has learned this song yet\. The sight-reader plays it zero-shot/);
  assert.ok(await loudest('#player') > 0.05, 'the sound is not silence');
  await page.getByText('With three fingers: 44 notes').waitFor(LONG);
  await page.getByText(/Predicted zero-shot: 44 of 44 notes, F1 0\.9\d\d/).waitFor();
  assert.ok(await loudest('[data-key="reference"]') > 0.05);
  await page.getByText('16 bars').click();
  await page.getByText('C4 1   C4 1   C4 1   D4 1').first().waitFor();
});

test('one sound plays at a time', { skip }, async () => {
  await page.evaluate(() => document.querySelector('[data-key="reference"]').play());
  await page.waitForFunction(() => document.getElementById('player').paused);
});

test('what is no song is refused in words', { skip }, async () => {
  troubles.length = 0;
  await dropOn('words.mid', new TextEncoder().encode('no music'));
  await page.getByRole('alert').getByText('words.mid cannot be used').waitFor(LONG);
  await dropOn('large.mid', (1 << 20) + 1);
  await page.getByRole('alert').getByText('larger than 1 MiB').waitFor(LONG);
  // Chromium itself tells of an answer that is a refusal.
  assert.ok(troubles.every((text) => text.includes('422')), troubles.join('\n'));
  troubles.length = 0;
});

test('it survives a reload', { skip }, async () => {
  await page.reload();
  await page.getByText('With three fingers: 44 notes').waitFor(LONG);
  await page.getByRole('button', { name: /^Listen to out\/au-clair/ }).click();
  await page.waitForFunction(() => document.getElementById('player').currentTime > 0, null, LONG);
});

test('it performs on the twin, compares, and opens the replay', { skip }, async () => {
  // By keys alone.
  await page.getByRole('button', { name: 'Perform it on the twin' }).focus();
  await page.keyboard.press('Enter');
  await isDone('twin, real');
  const [hint, compare] = [page.getByText('mark two performances of one song'), page.getByRole('button', { name: 'Compare the two' })];
  assert.deepEqual([await hint.isVisible(), await compare.isEnabled()], [true, false]);
  for (const box of await page.getByRole('checkbox').all()) await box.check();
  assert.deepEqual([await hint.isVisible(), await compare.isEnabled()], [false, true]);
  await compare.click();
  await page.getByText('Of each note: onset and length').waitFor(LONG);
  const [replay] = await Promise.all([page.waitForEvent('popup'), page.getByRole('link', { name: 'Replay of both' }).click()]);
  const replayTroubles = [];
  replay.on('pageerror', (error) => replayTroubles.push(String(error)));
  await ready(replay);
  assert.deepEqual(replayTroubles, []);
  // A page from a file has no access to the server.
  const access = await replay.evaluate(() => fetch('../../../state').then(() => 'has access', () => 'none'));
  assert.equal(access, 'none');
  await replay.close();
});

test('it trains with live curves, and stops', { skip }, async () => {
  await page.getByLabel('Settings').fill(`${settings} trainer.total_steps=400000`);
  await page.getByRole('button', { name: 'Train a policy' }).click();
  await page.locator('.card polyline').first().waitFor({ state: 'attached', ...LONG });
  const points = () => page.locator('.card polyline').first().getAttribute('points');
  const first = await points();
  await page.waitForFunction((before) => document.querySelector('.card polyline').getAttribute('points').length > before, first.length, LONG);
  await page.getByRole('button', { name: /^Stop and save/ }).click();
  await isDone('Train au-clair-de-la-lune\nstopped');
  await page.getByRole('button', { name: /^Resume training/ }).waitFor(LONG);
});

test('a file can be chosen instead of dropped', { skip }, async () => {
  await page.locator('input[type="file"]').setInputFiles({ name: 'By Button.mid', mimeType: 'audio/midi', buffer: await readFile(songFile) });
  await page.locator('.playback').getByText('By Button, played by the policy policies/sight-reader.safetensors').waitFor(LONG);
  assert.equal(await page.locator('.song h2').first().innerText(), 'By Button');
});

test('what will be hard is listed, each with its bar and time', { skip }, async () => {
  // C4 four times in half a second, then a chord of three octaves.
  const fast = [0, 1, 2, 3].map((start) => [60, start, 1]);
  await dropOn('too-hard.mid', midi([...fast, [48, 8, 4], [84, 8, 4], [60, 16, 4]]));
  await page.locator('.playback').getByText('too-hard, played by').waitFor(LONG);
  await page.getByText(/Predicted zero-shot: \d of 7 notes/).waitFor(LONG);
  const hard = await page.locator('.song li').allInnerTexts();
  assert.ok(hard.some((text) => text.includes('bar 1, beat 3 (1.00 s): C6 is omitted: out of reach with the keys around it')), hard.join('\n'));
  assert.equal(hard.filter((text) => text.includes('C4 is struck again before the key has been up for long enough')).length, 3);
  await page.getByText('Easier: the upper voice alone, 6 of 6 notes.').waitFor(LONG);
  await page.getByRole('button', { name: 'Write this arrangement' }).click();
  await page.getByText('With three fingers: 6 notes').waitFor(LONG);
  assert.equal(await page.locator('.song h2').first().innerText(), 'too-hard melody');
});

test('a song beyond the keyboard is transposed by a click', { skip }, async () => {
  await dropOn('too-high.mid', midi([[84, 0, 4], [86, 4, 4]]));
  await page.locator('.song .problem').getByText('has notes outside the keyboard').waitFor(LONG);
  assert.equal(await page.getByRole('button', { name: 'Perform it on the twin' }).isVisible(), false);
  await page.getByRole('button', { name: 'Transpose by −2 semitones' }).click();
  await page.getByText('With three fingers: 2 notes').waitFor(LONG);
  assert.equal(await page.getByRole('button', { name: 'Perform it on the twin' }).isVisible(), true);
});

test('notes beyond the keyboard are left out by a click', { skip }, async () => {
  await dropOn('too-wide.mid', midi([[24, 0, 4], [60, 4, 4], [96, 8, 4], [62, 12, 4]]));
  await page.locator('.song').getByText('Keeps 2 of 4 notes.').waitFor(LONG);
  await page.getByRole('button', { name: 'Leave out 2 notes' }).click();
  await page.getByText('With three fingers: 2 notes').waitFor(LONG);
  assert.equal(await page.locator('.song h2').first().innerText(), 'too-wide within range');
  // Nothing would be left of this one.
  await dropOn('too-low.mid', midi([[24, 0, 4]]));
  await page.getByRole('button', { name: 'Transpose by +12 semitones' }).waitFor(LONG);
  assert.equal(await page.getByRole('button', { name: /^Leave out/ }).count(), 0);
  // The song of the tests that follow.
  await page.getByLabel('Song').selectOption('out/songs/too-high -2.mid');
  await page.getByText('With three fingers: 2 notes').waitFor(LONG);
});

test('two performances of different songs are not compared', { skip }, async () => {
  for (const box of await page.getByRole('checkbox').all()) await box.uncheck();
  for (const song of ['by-button', 'au-clair']) await page.getByRole('checkbox', { name: `Compare out/${song}` }).first().check();
  await page.getByText('mark two performances of one song').waitFor();
  assert.equal(await page.getByRole('button', { name: 'Compare the two' }).isEnabled(), false);
});

test('on a phone a tap brings what answers it into view, and nothing else moves the page', { skip }, async () => {
  const phone = await open({ viewport: { width: 390, height: 844 }, isMobile: true, hasTouch: true });
  await phone.getByText('With three fingers').waitFor(LONG);
  const seen = (selector) => phone.waitForFunction((which) => {
    const part = document.querySelector(which);
    const { top, bottom, height } = part.getBoundingClientRect();
    return part.textContent && height > 0 && top > -1 && bottom < window.innerHeight + 1;
  }, selector, LONG);
  const tap = async (name) => {
    const button = phone.getByRole('button', { name }).first();
    await button.evaluate((target) => target.scrollIntoView({ block: 'start' }));
    assert.ok(await phone.evaluate(() => document.querySelector('.trouble').getBoundingClientRect().bottom < 0));
    await button.tap();
  };
  const refuse = (route) => route.fulfill({ status: 409, contentType: 'application/json', body: '{"error":"This runs already."}' });
  await phone.route('**/jobs', refuse);
  for (const name of ['Play it', 'Perform it', 'Train a policy']) {
    await tap(name);
    await seen('.trouble');
  }
  await phone.unroute('**/jobs', refuse);
  await tap('Play it');
  await seen('.playback');
  // The server is asked again and again, and a refusal of that is not the answer to a tap.
  await phone.evaluate(() => window.scrollTo(0, document.body.scrollHeight));
  const place = await phone.evaluate(() => window.scrollY);
  await phone.route('**/state', (route) => route.abort());
  await phone.getByRole('alert').getByText('The server does not answer').waitFor({ state: 'attached', ...LONG });
  assert.ok(await phone.evaluate(() => window.scrollY) >= place);
  await phone.context().close();
  // Chromium itself tells of requests that fail.
  assert.ok(troubles.every((text) => /409|ERR_FAILED/.test(text)), troubles.join('\n'));
  troubles.length = 0;
});

test('a server that has ended is told of, until it answers again', { skip }, async () => {
  await page.route('**/state', (route) => route.abort());
  await page.getByRole('alert').getByText('The server does not answer').waitFor(LONG);
  await page.unroute('**/state');
  await page.waitForFunction(() => document.querySelector('[role="alert"]').textContent === '', null, LONG);
  // Chromium itself tells of a request that fails.
  assert.ok(troubles.every((text) => text.includes('ERR_FAILED')), troubles.join('\n'));
  troubles.length = 0;
});

for (const [look, options] of [
  ['wide-light', {}],
  ['wide-dark', { colorScheme: 'dark' }],
  ['phone-light', { viewport: { width: 390, height: 844 }, isMobile: true, hasTouch: true }],
  ['phone-dark', { viewport: { width: 390, height: 844 }, isMobile: true, hasTouch: true, colorScheme: 'dark' }],
]) {
  test(`it is accessible and whole: ${look}`, { skip }, async () => {
    const shown = await open(options);
    await shown.getByLabel('Song').selectOption('out/songs/au-clair-de-la-lune.mid');
    await shown.getByText('With three fingers: 44 notes').waitFor(LONG);
    await shown.getByRole('button', { name: /^Listen to out\/au-clair-de-la-lune\// }).click();
    await shown.getByLabel('Comparison').selectOption({ index: 1 });
    await shown.getByText('Of each note').waitFor(LONG);
    await shown.evaluate(() => document.querySelectorAll('details').forEach((details) => { details.open = true; }));
    await shown.evaluate(await readFile(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8'));
    const found = await shown.evaluate(() => window.axe.run({ preload: false }));
    const violations = found.violations.flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.target} ${node.failureSummary}`));
    assert.deepEqual(violations, []);
    assert.ok((await shown.evaluate(() => document.scrollingElement.scrollWidth - window.innerWidth)) <= 0, 'no sideways scrolling');
    const tall = await shown.evaluate(() => [...document.querySelectorAll('td, .performances p, .result')].filter((part) => part.clientHeight > 70).map((part) => part.innerText));
    assert.deepEqual(tall, [], 'no cell has more than three lines');
    await shown.screenshot({ path: path.join(screenshots, `work-${look}.png`), fullPage: true });
    await shown.context().close();
  });
}

test('nothing was told in the console', { skip }, () => {
  assert.deepEqual(troubles, []);
});
