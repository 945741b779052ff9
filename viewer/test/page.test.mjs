/**
 * The page in Chromium. `ETUDE_REPLAY_PAGE` names a page that `etude replay` wrote; without it a made-up take stands in.
 * `ETUDE_REPLAY_BOTH` names one with two takes of which parts differ. `ETUDE_SCREENSHOTS` names the folder for screenshots.
 */

import assert from 'node:assert/strict';
import { mkdir, readFile, stat } from 'node:fs/promises';
import os from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';

import { launch, ready } from './browser.mjs';
import { HZ, heldThrough, oneTake, sampleTake, twoTakes } from './sample.mjs';

const LARGEST_BYTES = 4 * 1024 * 1024;
const PHONE = { width: 390, height: 844, touch: true };
const screenshots = process.env.ETUDE_SCREENSHOTS ?? os.tmpdir();

let browser;
let given;
let data;

before(async () => {
  await mkdir(screenshots, { recursive: true });
  browser = await launch();
  given = process.env.ETUDE_REPLAY_PAGE ?? (await browser.write(oneTake()));
  data = await dataOf(given);
});

after(() => browser?.close());

/** The data of a page. */
async function dataOf(file) {
  const html = await readFile(file, 'utf8');
  return JSON.parse(html.match(/<script type="application\/json" id="data">([^<]*)<\/script>/)[1]);
}

/** Opens a page, does something with it, and holds that nothing went wrong and nothing was fetched. */
async function withPage(file, options, act) {
  const page = await browser.open(file, options);
  try {
    await ready(page);
    await act(page);
    assert.deepEqual(page.troubles, []);
    assert.deepEqual(page.requests, []);
  } finally {
    await page.context().close();
  }
}

const overflow = (page) => page.evaluate(() => document.scrollingElement.scrollWidth - window.innerWidth);

test('one file of a bearable size', async () => {
  assert.ok((await stat(given)).size < LARGEST_BYTES);
});

test('opens, plays, scrubs, turns and closes without a complaint', async () => {
  await withPage(given, {}, async (page) => {
    const etude = (call) => page.evaluate(`window.etude.${call}`);
    const [take] = data.takes;
    assert.equal(await etude('camera()'), 'fingers');
    assert.ok(Math.abs((await etude('duration()')) - take.due.length / take.control_hz) < 1);

    await page.keyboard.press('Space');
    assert.equal(await etude('playing()'), true);
    await page.waitForFunction(() => window.etude.time() > 0.5);
    await page.keyboard.press('Space');
    assert.equal(await etude('playing()'), false);

    await page.locator('input.place').fill('2.5');
    assert.ok(Math.abs((await etude('time()')) - 2.5) < 1e-6);
    await page.keyboard.press('ArrowRight');
    assert.ok(Math.abs((await etude('time()')) - (2.5 + 1 / take.control_hz)) < 1e-6);
    await page.keyboard.press('Shift+ArrowLeft');
    assert.ok(Math.abs((await etude('time()')) - (1.5 + 1 / take.control_hz)) < 1e-6);
    await page.keyboard.press('End');
    assert.equal(await etude('time()'), await etude('duration()'));
    await page.keyboard.press('Home');
    assert.equal(await etude('time()'), 0);

    for (const [key, name] of [['2', 'side'], ['3', 'top'], ['4', 'fingers'], ['1', 'player']]) {
      await page.keyboard.press(key);
      assert.equal(await etude('camera()'), name);
    }
    await page.getByRole('button', { name: 'Side', exact: true }).click();
    assert.equal(await etude('camera()'), 'side');

    await etude('seek(2)');
    await page.keyboard.press('l');
    const loop = await etude('loop()');
    assert.ok(loop.from <= 2 && loop.to > 2);
    await page.keyboard.press('l');
    assert.equal(await etude('loop()'), null);

    await page.keyboard.press('?');
    assert.ok(await page.getByRole('dialog').isVisible());
    await page.keyboard.press('Escape');
  });
});

test('opens at the first note, whose key is lit, and plays from there at a click', async () => {
  await withPage(given, {}, async (page) => {
    const starts = data.takes.slice(0, 2).map((take) => take.due_notes[0].start);
    const first = Math.max(...starts);
    assert.equal(await page.evaluate(() => window.etude.time()), first);
    const lit = await page.evaluate(() => window.etude.keysShown(0));
    assert.ok(data.takes[0].due_notes[0].pitch in lit, JSON.stringify(lit));
    await page.getByRole('button', { name: 'Play with sound' }).click();
    await page.waitForFunction((secs) => window.etude.time() > secs, first);
    assert.equal(await page.evaluate(() => window.etude.playing()), true);
    assert.equal(await page.getByRole('button', { name: 'Play with sound' }).count(), 0);
  });
});

test('each octave of the keyboard is named', async () => {
  await withPage(given, {}, async (page) => {
    assert.deepEqual(await page.evaluate(() => window.etude.keyNames(0)), ['C2', 'C3', 'C4', 'C5', 'C6']);
  });
});

test('keys drawn down are the keys that were pressed', async () => {
  await withPage(given, {}, async (page) => {
    for (const [pane, take] of data.takes.slice(0, 2).entries()) {
      const moments = steadyMoments(take);
      assert.equal(moments.length, 3, 'a recording with three notes');
      for (const step of moments) {
        await page.evaluate((secs) => window.etude.seek(secs), (step + 1) / take.control_hz);
        const down = await page.evaluate((index) => window.etude.keysDown(index), pane);
        assert.deepEqual(down, [...take.pressed[step]].sort((a, b) => a - b), `pane ${pane}, step ${step}`);
      }
    }
  });
});

/** Three steps, early, in the middle and late, in which keys are held that also were before and will be after. */
function steadyMoments({ pressed }) {
  const steady = [];
  for (let step = 1; step + 1 < pressed.length; step += 1) {
    const same = (other) => String(pressed[other]) === String(pressed[step]);
    if (pressed[step].length > 0 && same(step - 1) && same(step + 1)) steady.push(step);
  }
  return [0.1, 0.5, 0.9].map((share) => steady[Math.floor(share * steady.length)]).filter((step) => step !== undefined);
}

test('every note played in a stretch is heard, and in its time', async () => {
  await withPage(given, {}, async (page) => {
    const take = data.takes.slice(0, 2).at(-1);
    const from = Math.max(0, take.notes[2].start - 0.3);
    await page.evaluate((secs) => window.etude.seek(secs), from);
    await page.evaluate(() => window.etude.play());
    await page.waitForFunction((secs) => window.etude.time() > secs, from + 3);
    const to = await page.evaluate(() => {
      window.etude.pause();
      return window.etude.time();
    });
    const heard = await page.evaluate(() => window.etude.scheduled());
    const played = take.notes.filter((note) => note.start >= from && note.start < to);
    assert.ok(played.length > 1);
    const first = heard.find((note) => note.pitch === played[0].pitch);
    played.forEach((note) => {
      const found = heard.find(({ pitch, velocity, when }) =>
        pitch === note.pitch && velocity === note.velocity && Math.abs(when - first.when - (note.start - played[0].start)) < 0.06);
      assert.ok(found, `${note.pitch} at ${note.start} s among ${JSON.stringify(heard)}`);
    });
  });
});

test('the song as written is heard instead of the performance, from one moment to the next', async () => {
  await withPage(given, {}, async (page) => {
    const take = data.takes.slice(0, 2).at(-1);
    const from = take.due_notes[2].start - 0.3;
    const written = page.getByRole('button', { name: 'As written' });
    assert.equal(await written.getAttribute('aria-pressed'), 'false');
    await page.evaluate((secs) => window.etude.seek(secs), from);
    await page.evaluate(() => window.etude.play());
    await page.waitForFunction(() => window.etude.scheduled().length > 0);
    const before = await page.evaluate(() => window.etude.scheduled().length);
    await page.keyboard.press('r');
    assert.equal(await written.getAttribute('aria-pressed'), 'true');
    await page.waitForFunction((secs) => window.etude.time() > secs, from + 3);
    await written.click();
    assert.equal(await written.getAttribute('aria-pressed'), 'false');
    const heard = await page.evaluate((count) => window.etude.scheduled().slice(count), before);
    const due = take.due_notes.filter((note) => note.start > from + 1 && note.start < from + 3);
    assert.ok(due.length > 1);
    const first = heard.find((note) => note.pitch === due[0].pitch && note.velocity === due[0].velocity);
    for (const note of due) {
      const found = heard.find(({ pitch, velocity, when }) =>
        pitch === note.pitch && velocity === note.velocity && Math.abs(when - first.when - (note.start - due[0].start)) < 0.06);
      assert.ok(found, `${note.pitch} at ${note.start} s among ${JSON.stringify(heard)}`);
    }
  });
});

test('each due note is listed with how it was played, and a click goes there', async () => {
  await withPage(given, {}, async (page) => {
    const take = data.takes[0];
    const rows = page.locator('.notes ol > li');
    assert.equal(await rows.count(), take.due_notes.length);
    const heard = take.note_scores;
    await page.getByText(`${heard.matched} of ${heard.matched + heard.missed} notes right, ${heard.wrong} wrong`).first().waitFor();
    for (const [index, due] of take.due_notes.entries()) {
      const says = await rows.nth(index).textContent();
      const played = take.matches[index] && take.notes[take.matches[index].note];
      if (!played) assert.match(says, /missed/);
      else assert.ok(says.includes(String(played.velocity)), says);
      if (played && !take.matches[index].right) assert.match(says, /too (late|early)/);
      assert.equal(/missed|too/.test(says), !take.matches[index]?.right, `${says} of ${JSON.stringify(due)}`);
    }
    const [one, other] = [await rows.nth(0).boundingBox(), await rows.nth(1).boundingBox()];
    assert.ok(other.x > one.x && other.y === one.y, 'on a wide page several stand in a line');
    await rows.nth(2).getByRole('button').click();
    assert.ok(Math.abs((await page.evaluate(() => window.etude.time())) - take.due_notes[2].start) < 1e-6);
  });
});

test('a note that was not struck is missed in the roll and on the keyboard, also if its key was held', async () => {
  await withPage(await browser.write({ version: 1, takes: [heldThrough()], differences: [] }), {}, async (page) => {
    assert.equal(await page.locator('.roll').getAttribute('aria-label'), 'Piano roll. Notes: 1 right, 0 too early or too late, 1 missed. Wrong strokes: 0.');
    const shown = (secs) => page.evaluate((at) => {
      window.etude.seek(at);
      return window.etude.keysShown(0);
    }, secs);
    assert.deepEqual(await shown(0.5), {});
    assert.deepEqual(await shown(1.5), { 60: 'right' });
    assert.deepEqual(await shown(2.5), { 60: 'missed' });
    const kinds = ['right', 'too early or too late', 'missed', 'wrong stroke'];
    assert.deepEqual(await page.locator('.rolls .item').allTextContents(), ['due', ...kinds]);
    assert.deepEqual(await page.locator('.key-colours .item').allTextContents(), ['due', ...kinds, 'fence between keys']);
  });
});

test('the roll and its legend have one mark for each kind', async () => {
  const due = [60, 62, 64].map((pitch, index) => ({ pitch, start: 1 + index, end: 1.8 + index, velocity: 60 }));
  const notes = [60, 62, 70].map((pitch, index) => ({ pitch, start: 1.08 * (1 + index), end: 1.9 + index, velocity: 60 }));
  const take = { ...sampleTake({ steps: 120 }), due_notes: due, notes, matches: [{ note: 0, right: true }, { note: 1, right: false }, null] };
  await withPage(await browser.write({ version: 1, takes: [take], differences: [] }), {}, async (page) => {
    const [drawn, legend] = await page.evaluate(() => {
      const found = { frames: [], fills: [] };
      const { prototype } = CanvasRenderingContext2D;
      const { strokeRect, fillRect } = prototype;
      prototype.strokeRect = function note(...place) {
        found.frames.push(`${this.lineWidth}px ${this.strokeStyle}`);
        strokeRect.call(this, ...place);
      };
      prototype.fillRect = function note(...place) {
        found.fills.push(`${this.fillStyle} ${this.globalAlpha.toFixed(2)}`);
        fillRect.call(this, ...place);
      };
      document.querySelector('.roll').dispatchEvent(new Event('scroll'));
      Object.assign(prototype, { strokeRect, fillRect });
      const pen = document.createElement('canvas').getContext('2d');
      const marks = [...document.querySelectorAll('.rolls .swatch')].map((swatch) => {
        const { borderTopWidth, borderTopColor, backgroundColor } = getComputedStyle(swatch);
        pen.fillStyle = borderTopColor;
        const frame = `${borderTopWidth} ${pen.fillStyle}`;
        const [red, green, blue, alpha = 1] = backgroundColor.match(/[\d.]+/g);
        pen.fillStyle = `rgb(${red} ${green} ${blue})`;
        return [swatch.classList[1], { frame, fill: `${pen.fillStyle} ${Number(alpha).toFixed(2)}` }];
      });
      return [found, Object.fromEntries(marks)];
    });
    const { due: asked, right, off, missed, wrong } = legend;
    assert.deepEqual(drawn.frames, [asked, asked, off, missed].map(({ frame }) => frame));
    assert.ok(drawn.fills.includes('[object CanvasPattern] 1.00'), 'missed is hatched');
    for (const { fill } of [right, off, wrong]) assert.ok(drawn.fills.includes(fill), `${fill} among ${drawn.fills}`);
    const onKeys = await page.locator('.key-colours .due').evaluate((swatch) => getComputedStyle(swatch).backgroundColor);
    assert.equal(await page.locator('.rolls .swatch.due').evaluate((swatch) => getComputedStyle(swatch).borderTopColor), onKeys);
  });
});

test('the legends of a recording that is not judged have no kind that it does not show', async () => {
  const old = { ...sampleTake({ steps: 60 }), due_notes: [], matches: [] };
  await withPage(await browser.write({ version: 1, takes: [old], differences: [] }), {}, async (page) => {
    assert.deepEqual(await page.locator('.rolls .item').allTextContents(), ['played']);
    assert.deepEqual(await page.locator('.key-colours .item').allTextContents(), ['fence between keys']);
  });
});

test('the mistakes are listed by kind, each once, and a click goes there', async () => {
  const due = [60, 62, 64, 65, 67].map((pitch, index) => ({ pitch, start: 1 + index, end: 1.8 + index, velocity: index === 4 ? 61 : 60 }));
  const stroke = (pitch, start, velocity) => ({ pitch, start, end: start + 0.25, velocity });
  const notes = [stroke(60, 1, 61), stroke(62, 2.08, 60), stroke(64, 2.93, 101), stroke(65, 4, 19), stroke(70, 4.5, 60)];
  const matches = [{ note: 0, right: true }, { note: 1, right: false }, { note: 2, right: false }, { note: 3, right: true }, null];
  const wrong = { ...sampleTake({ steps: 120 }), due_notes: due, notes, matches };
  const right = { ...wrong, notes: due, matches: due.map((_, note) => ({ note, right: true })) };
  await withPage(await browser.write({ version: 1, takes: [wrong, right], differences: [] }), {}, async (page) => {
    const list = page.getByRole('group', { name: 'Mistakes of take A' });
    assert.deepEqual(await list.locator('.kind').allTextContents(), [
      'missed: 10:05.0 G4', 'too early: 10:03.0 E4, 70 ms early', 'too late: 10:02.0 D4, 80 ms late', 'wrong stroke: 10:04.5 A♯4, held 250 ms',
      'too loud: 10:03.0 E4, 101, not 60', 'too soft: 10:04.0 F4, 19, not 60',
    ]);
    const roll = await page.locator('.roll').first().getAttribute('aria-label');
    assert.equal(roll, 'Piano roll. Notes: 2 right, 2 too early or too late, 1 missed. Wrong strokes: 1.');
    await list.getByRole('button', { name: 'A♯4' }).click();
    assert.equal(await page.evaluate(() => window.etude.time()), 4.5);
    const shown = (secs) => page.evaluate((at) => {
      window.etude.seek(at);
      return window.etude.keysShown(0);
    }, secs);
    assert.deepEqual([await shown(2.1), await shown(2.95), await shown(4.6), await shown(5.1)], [{ 62: 'off' }, { 64: 'off' }, { 65: 'due', 70: 'wrong' }, { 67: 'missed' }]);
    assert.equal(await page.getByRole('group', { name: 'Mistakes of take B' }).locator('p').textContent(), 'No mistakes.');
  });
  // A song that is written equally loud throughout: none is too loud or too soft.
  const even = { ...wrong, due_notes: due.map((note) => ({ ...note, velocity: 60 })) };
  await withPage(await browser.write({ version: 1, takes: [even], differences: [] }), {}, async (page) => {
    const kinds = await page.getByRole('group', { name: 'Mistakes' }).locator('.kind > span').allTextContents();
    assert.deepEqual(kinds, ['missed: 1', 'too early: 1', 'too late: 1', 'wrong stroke: 1']);
  });
});

test('on a phone a mistake that is tapped brings its scene into view, and the notes are no wider than the page', async () => {
  await withPage(await browser.write(twoTakes()), PHONE, async (page) => {
    const seen = (pane) => page.evaluate((index) => {
      const { top, bottom } = document.querySelectorAll('.frame')[index].getBoundingClientRect();
      return top > -1 && bottom < window.innerHeight + 1;
    }, pane);
    for (const [pane, letter] of ['A', 'B'].entries()) {
      const mistake = page.getByRole('group', { name: `Mistakes of take ${letter}` }).getByRole('button').last();
      await mistake.scrollIntoViewIfNeeded();
      assert.equal(await seen(pane), false);
      await mistake.tap();
      assert.equal(await seen(pane), true, letter);
    }
    assert.ok(await page.locator('.notes ol').evaluate((list) => list.scrollWidth <= list.clientWidth));
  });
});

test('the roll names the keys that occur, and numbers the bars', async () => {
  await withPage(await browser.write({ version: 1, takes: [heldThrough()], differences: [] }), {}, async (page) => {
    const written = await page.evaluate(() => {
      const found = [];
      const { prototype } = CanvasRenderingContext2D;
      const { fillText } = prototype;
      prototype.fillText = function note(text, ...place) {
        found.push(text);
        fillText.call(this, text, ...place);
      };
      document.querySelector('.roll').dispatchEvent(new Event('scroll'));
      prototype.fillText = fillText;
      return found;
    });
    assert.deepEqual(written, ['1', '2', 'C4']);
  });
});

test('a reward term that is constant in all takes is named and not drawn', async () => {
  const [one, other] = [7, 29].map((seed) => sampleTake({ seed, steps: 200 }));
  const varied = (name) => ({ name, values: one.rewards[0].values });
  const constant = (name, value) => ({ name, values: one.due.map(() => value) });
  one.rewards = [varied('key_press'), constant('energy', -0), constant('collision', 0.5), constant('wrong_travel', 0)];
  other.rewards = [constant('key_press', 1), constant('energy', 0), constant('collision', 0.25), varied('wrong_travel')];
  await withPage(await browser.write({ version: 1, takes: [one, other], differences: [] }), {}, async (page) => {
    assert.deepEqual(await page.locator('.plot figcaption > span').allTextContents(), ['F1', 'precision', 'recall', 'key press', 'wrong travel']);
    await page.getByText('Not drawn, because constant: energy 0, collision A 0.5 B 0.25.', { exact: true }).waitFor({ timeout: 5000 });
  });
});

test('of two takes it is said which one a remark is true of, what is counted is named, and minus is a sign of its own', async () => {
  const [one, other] = [7, 29].map((seed) => sampleTake({ seed, steps: 60 }));
  one.rewards = [{ name: 'energy', values: one.due.map((_, step) => (step === 0 ? -0.0001 : -0.25)) }];
  other.rewards = [];
  other.rewards_note = 'Energy was left out.';
  other.marks = [1, 2].map((secs) => ({ secs, kind: 'clamp', text: 'rail' }));
  await withPage(await browser.write({ version: 1, takes: [one, other], differences: [[1, 1.1]] }), {}, async (page) => {
    assert.equal(await page.locator('.numbers > .note').last().textContent(), 'B: Energy was left out.');
    assert.deepEqual(await page.locator('.marks .item').allTextContents(), ['2 stretches of limited set-points', '1 place where A and B sound different keys']);
    const energy = page.locator('.plot').last().locator('output').first();
    for (const [secs, says] of [[1 / HZ, 'A 0.000'], [1, 'A −0.250']]) {
      await page.evaluate((at) => window.etude.seek(at), secs);
      assert.equal(await energy.textContent(), says);
    }
  });
  const both = [one, other].map((take) => ({ ...take, marks: [other.marks[0]], rewards_note: 'Energy was left out.' }));
  await withPage(await browser.write({ version: 1, takes: both, differences: [] }), {}, async (page) => {
    assert.equal(await page.locator('.numbers > .note').last().textContent(), 'A and B: Energy was left out.');
  });
  await withPage(await browser.write({ version: 1, takes: [both[0]], differences: [] }), {}, async (page) => {
    assert.equal(await page.locator('.numbers > .note').last().textContent(), 'Energy was left out.');
    assert.deepEqual(await page.locator('.marks .item').allTextContents(), ['1 stretch of limited set-points']);
  });
});

test('of a nearly perfect song a score is drawn from its lowest value on, and one that stays perfect is named', async () => {
  const take = sampleTake({ steps: 200 });
  take.running = { f1: take.due.map((_, step) => (step < 90 ? 1 : 0.978)), precision: take.due.map(() => 1), recall: take.due.map(() => 1) };
  take.rewards = [];
  await withPage(await browser.write({ version: 1, takes: [take], differences: [] }), {}, async (page) => {
    assert.deepEqual(await page.locator('.plot figcaption > span').allTextContents(), ['F1']);
    await page.getByText('Not drawn, because constant: precision 1, recall 1.', { exact: true }).waitFor({ timeout: 5000 });
    await page.evaluate(() => {
      window.written = [];
      const { prototype } = CanvasRenderingContext2D;
      const { fillText } = prototype;
      prototype.fillText = function note(text, ...place) {
        if (this.canvas.closest('.plot')) window.written.push(text);
        fillText.call(this, text, ...place);
      };
    });
    await page.setViewportSize({ width: 1000, height: 720 });
    await page.waitForFunction(() => window.written.length > 0);
    assert.deepEqual(await page.evaluate(() => window.written.slice(0, 2)), ['1', '0.97']);
  });
});

test('of a piece of twenty minutes the charts and the bars on the time line stay apart, and a short one is drawn step by step', async () => {
  const each = (make) => Array.from({ length: 24_000 }, (_, step) => make(step));
  const take = { ...sampleTake({ steps: 60 }), due: each(() => []), pressed: each(() => []), running: {}, bar_secs: each((step) => step / HZ).filter((_, step) => step % 40 === 0) };
  take.rewards = [{ name: 'key_press', values: each((step) => step % 2) }];
  const isNoted = (page) => page.getByText('One pixel of a chart is several control steps').isVisible();
  for (const options of [{}, PHONE]) {
    await withPage(await browser.write({ version: 1, takes: [take], differences: [] }), options, async (page) => {
      const [solid, pale] = await page.locator('.plot canvas').evaluate((canvas) => {
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        const alphas = data.filter((_, byte) => byte % 4 === 3);
        const share = (is) => alphas.filter(is).length / alphas.length;
        return [share((alpha) => alpha > 200), share((alpha) => alpha > 0 && alpha < 100)];
      });
      assert.ok(solid < 0.2 && pale > 0.4, `${solid} of the chart is solid, ${pale} pale`);
      const lines = await page.locator('.strip').evaluate((strip) => {
        const { data } = strip.getContext('2d').getImageData(0, 0, strip.width, 1);
        const reds = data.filter((_, byte) => byte % 4 === 0);
        return reds.filter((red) => red === Math.min(...reds)).length / reds.length;
      });
      assert.ok(lines > 0 && lines < 0.2, `${lines} of the time line is bar lines`);
      assert.equal(await isNoted(page), true);
    });
    await withPage(await browser.write(oneTake()), options, async (page) => assert.equal(await isNoted(page), false));
  }
});

test('on a phone a list that scrolls has a shadow at an edge behind which there is more, and a scrollbar', async () => {
  const marks = Array.from({ length: 20 }, (_, index) => ({ secs: index, kind: 'warning', text: 'late' }));
  const take = { ...sampleTake({ marks }), notes: [] };
  take.matches = take.due_notes.map(() => null);
  for (const dark of [false, true]) {
    await withPage(await browser.write({ version: 1, takes: [take], differences: [] }), { ...PHONE, dark }, async (page) => {
      await page.getByText('On the time line').click();
      for (const name of ['.marks ol', '.mistakes', '.notes ol']) {
        const list = page.locator(name);
        await list.evaluate((target) => target.scrollIntoView({ block: 'center' }));
        assert.equal(await list.evaluate((target) => getComputedStyle(target, '::-webkit-scrollbar').width), '8px', name);
        /** Which edges have a shadow, when the list is scrolled so far. */
        const shaded = async (share) => {
          await list.evaluate((target, part) => target.scrollTo(0, part * target.scrollHeight), share);
          const { x, y, height } = await list.boundingBox();
          const [middle, ...edges] = await Promise.all([height / 2, 4, height - 5].map((down) => greenAt(page, x + 3, y + down)));
          return edges.map((edge) => Math.abs(edge - middle) > 8);
        };
        assert.deepEqual([await shaded(0), await shaded(0.3), await shaded(1)], [[false, true], [true, true], [true, false]], name);
      }
    });
  }
});

/** The green of a pixel of the page, from 0 to 255. */
async function greenAt(page, x, y) {
  const picture = await page.screenshot({ clip: { x: Math.round(x), y: Math.round(y), width: 1, height: 1 } });
  return page.evaluate(async (address) => {
    const image = new Image();
    image.src = address;
    await image.decode();
    const pen = document.createElement('canvas').getContext('2d');
    pen.drawImage(image, 0, 0);
    return pen.getImageData(0, 0, 1, 1).data[1];
  }, `data:image/png;base64,${picture.toString('base64')}`);
}

test('half speed takes twice as long', async () => {
  await withPage(given, {}, async (page) => {
    await page.keyboard.press('h');
    const speed = await page.evaluate(async () => {
      window.etude.play();
      await new Promise((resolve) => setTimeout(resolve, 700));
      const [song, clock] = [window.etude.time(), performance.now()];
      await new Promise((resolve) => setTimeout(resolve, 1500));
      return ((window.etude.time() - song) * 1000) / (performance.now() - clock);
    });
    // Far from full speed, and with room for a machine that has other things to do.
    assert.ok(speed > 0.3 && speed < 0.7, `${speed}`);
  });
});

for (const dark of [false, true]) {
  for (const [width, options] of [['wide', {}], ['phone', PHONE]]) {
    test(`looks right ${dark ? 'dark' : 'light'} and ${width}`, async () => {
      await withPage(given, { ...options, dark }, async (page) => {
        await page.evaluate(() => window.etude.seek(0.4 * window.etude.duration()));
        assert.ok((await overflow(page)) <= 0, 'no sideways scrolling');
        await page.waitForTimeout(500);
        await page.screenshot({ path: path.join(screenshots, `replay-${width}-${dark ? 'dark' : 'light'}.png`), fullPage: true });
      });
    });
  }
}

test('two takes stand side by side, with the places where they part', async () => {
  const file = process.env.ETUDE_REPLAY_BOTH ?? (await browser.write(twoTakes()));
  const two = await dataOf(file);
  for (const [name, options] of [['wide', {}], ['phone', PHONE]]) {
    await withPage(file, options, async (page) => {
      assert.equal(await page.locator('canvas.scene').count(), 2);
      const [from] = two.differences[0];
      assert.match(await page.locator('.marks .item').last().textContent(), /^\d+ places where A and B sound different keys$/);
      const hatched = await page.locator('.marks .item canvas').last().evaluate((canvas) => {
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        return new Set(data.filter((_, byte) => byte % 4 === 3)).size > 1;
      });
      assert.ok(hatched, 'the legend shows the hatch');
      await page.getByText('On the time line').click();
      await page.getByRole('button', { name: 'A and B sound different keys' }).first().click();
      assert.ok(Math.abs((await page.evaluate(() => window.etude.time())) - from) < 1e-6);
      assert.ok((await overflow(page)) <= 0);
      const notes = page.locator('.notes ol > li');
      assert.equal(await notes.count(), two.takes[0].due_notes.length);
      const both = await notes.evaluateAll((items) => items.map((item) => [...item.querySelectorAll('p')].map((played) => played.textContent[0]).join('')));
      assert.ok(both.every((letters) => letters === 'AB'), 'each note as A and as B played it');
      await page.getByRole('button', { name: 'As written' }).click();
      await page.getByRole('button', { name: 'Hear take A' }).click();
      assert.equal(await page.getByRole('button', { name: 'As written' }).getAttribute('aria-pressed'), 'false');
      await page.screenshot({ path: path.join(screenshots, `replay-two-${name}.png`), fullPage: true });
    });
  }
});

test('two scenes stand at one height, also if one caption is longer', async () => {
  const takes = ['simulation', 'a robot with a name that is so long that it needs a line of its own in the caption of its scene'].map((rig) => sampleTake({ steps: 60, rig }));
  await withPage(await browser.write({ version: 1, takes, differences: [] }), {}, async (page) => {
    const [one, other] = await page.locator('.frame').all();
    assert.deepEqual((({ y, height }) => [y, height])(await one.boundingBox()), (({ y, height }) => [y, height])(await other.boundingBox()));
  });
});

test('takes of two songs are named by both', async () => {
  const takes = ['One', 'Two'].map((song, seed) => ({ ...sampleTake({ seed, steps: 60 }), song }));
  await withPage(await browser.write({ version: 1, takes, differences: [] }), {}, async (page) => {
    assert.equal(await page.locator('h1').textContent(), 'One and Two');
    assert.match(await page.locator('figcaption .what').nth(1).textContent(), /^Two · simulation/);
  });
});

test('more than two takes are chosen from', async () => {
  const takes = [1, 2, 3].map((seed) => ({ ...sampleTake({ seed, steps: 60 }), name: `take ${seed}` }));
  await withPage(await browser.write({ version: 1, takes, differences: [] }), {}, async (page) => {
    await page.getByRole('combobox', { name: 'Take B' }).selectOption('take 3');
    await page.evaluate(() => window.etude.seek(1.5));
    const step = 1.5 * HZ - 1;
    assert.deepEqual(await page.evaluate(() => window.etude.keysDown(1)), takes[2].pressed[step]);
  });
});

test('hostile names stay text', async () => {
  const evil = '</script><script>window.broken=1</script>"><img src=x onerror="window.broken=1"><!--<script>';
  const hostile = sampleTake({ steps: 60, rig: evil, mode: evil, marks: [{ secs: 1, kind: evil, text: evil }, { secs: 2, kind: 'fault', text: evil }] });
  Object.assign(hostile, { name: evil, song: evil, player: evil, incomplete: evil, rewards_note: evil });
  hostile.rewards[0].name = evil;
  hostile.scene.bodies[0].name = evil;
  hostile.scene.geoms[0].name = evil;
  await withPage(await browser.write({ version: 1, takes: [hostile], differences: [] }), PHONE, async (page) => {
    await page.evaluate(() => window.etude.seek(1));
    assert.equal(await page.evaluate(() => window.broken), undefined);
    assert.equal(await page.locator('img').count(), 0);
    assert.equal(await page.locator('h1').textContent(), evil);
    assert.ok((await overflow(page)) <= 0);
  });
});

const BROKEN = {
  'no step': { take: sampleTake({ steps: 0 }), says: 'no control step' },
  'one step': { take: sampleTake({ steps: 1 }), says: 'No note was due' },
  'nothing due': { take: { ...sampleTake({ steps: 100 }), due: Array.from({ length: 100 }, () => []), due_notes: [], matches: [] }, says: 'No note was due' },
  'half a recording': { take: { ...sampleTake({ steps: 100 }), incomplete: 'The file ends in the middle of a record.' }, says: 'ends in the middle' },
  'an empty object': { take: {}, says: 'no control step' },
  'keys and no hand': { take: { ...sampleTake({ steps: 100 }), positions: [], start: null, rewards: [], final: null, bar_secs: [] }, says: 'hand does not move' },
};

for (const [name, { take, says }] of Object.entries(BROKEN)) {
  test(`${name} is shown as far as it goes`, async () => {
    await withPage(await browser.write({ version: 1, takes: [take], differences: [] }), {}, async (page) => {
      await page.getByText(says).first().waitFor({ timeout: 20_000 });
      await page.evaluate(() => {
        window.etude.play();
        window.etude.seek(0.5 * window.etude.duration());
      });
      for (const key of ['l', 'ArrowRight', 'End', 'Home']) await page.keyboard.press(key);
      assert.ok((await page.evaluate(() => window.etude.time())) <= (await page.evaluate(() => window.etude.duration())));
    });
  });
}

test('a page that holds no recording says so', async () => {
  for (const nothing of [{ version: 1, takes: [], differences: [] }, { version: 2 }, null]) {
    const page = await browser.open(await browser.write(nothing));
    await page.getByRole('alert').waitFor({ timeout: 5000 });
    assert.deepEqual(page.troubles, []);
    await page.context().close();
  }
});
