/** What is checked in is what the sources build. */

import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { mkdtemp, readFile, rm } from 'node:fs/promises';
import os from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

import { buildInto } from '../build.mjs';

const dist = path.join(path.dirname(fileURLToPath(import.meta.url)), '..', 'dist');
/** Of each page: script, style, policy. */
const PAGES = [['replay.js', 'replay.css', 'csp.txt'], ['work.js', 'work.css', 'work-csp.txt']];

test('dist is what the sources build, byte for byte', async () => {
  const folder = await mkdtemp(path.join(os.tmpdir(), 'etude-bundle-'));
  try {
    await buildInto(folder);
    for (const name of PAGES.flat()) {
      const [built, kept] = await Promise.all([folder, dist].map((where) => readFile(path.join(where, name))));
      assert.ok(built.equals(kept), `dist/${name} is not what the sources build: run npm run build`);
    }
  } finally {
    await rm(folder, { recursive: true, force: true });
  }
});

for (const files of PAGES) {
  test(`the policy lets ${files[0]} and its style run, and nothing else`, async () => {
    const [script, style, policy] = await Promise.all(files.map((name) => readFile(path.join(dist, name), 'utf8')));
    for (const text of [script, style]) {
      assert.ok(policy.includes(createHash('sha256').update(text).digest('base64')));
      assert.ok(!text.includes('\r'), 'a browser would read other text than was hashed');
    }
    assert.ok(!/unsafe|http/.test(policy));
  });
}
