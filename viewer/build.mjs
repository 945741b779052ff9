/**
 * Builds what `etude replay` and `etude serve` put into their pages: of each the script, the style sheet, and the policy that lets
 * nothing else run. The same sources give the same bytes.
 *
 *     node build.mjs [FOLDER]      (default: dist)
 */

import { createHash } from 'node:crypto';
import { mkdir, writeFile } from 'node:fs/promises';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

import { build } from 'esbuild';

const here = path.dirname(fileURLToPath(import.meta.url));

/** The pages: entry points, names of the files, and what a page may fetch. */
const PAGES = [
  { script: 'src/main.js', style: 'src/page.css', name: 'replay', policy: 'csp.txt', media: 'data: blob:', connect: "'none'" },
  { script: 'src/work/main.js', style: 'src/work/work.css', name: 'work', policy: 'work-csp.txt', media: "'self'", connect: "'self'" },
];

/** Builds into `folder`. */
export async function buildInto(folder) {
  await mkdir(folder, { recursive: true });
  for (const page of PAGES) await buildPage(page, folder);
}

async function buildPage(page, folder) {
  const { outputFiles } = await build({
    absWorkingDir: here,
    entryPoints: [{ in: page.script, out: page.name }, { in: page.style, out: page.name }],
    outdir: 'dist',
    bundle: true,
    minify: true,
    format: 'iife',
    target: ['es2022', 'chrome110', 'firefox110', 'safari16.4'],
    charset: 'utf8',
    legalComments: 'eof',
    write: false,
  });
  const text = (ending) => outputFiles.find((file) => file.path.endsWith(ending)).text;
  const [script, style] = [text('.js'), text('.css')];
  // Either would end the element that the text stands in, or change how it is read.
  for (const [content, forbidden] of [[script, /<\/script|<script|<!--/i], [style, /<\/style|<!--/i]]) {
    const found = content.match(forbidden);
    if (found) throw new Error(`the bundle contains ${found[0]}: ${content.slice(found.index - 60, found.index + 60)}`);
  }
  await writeFile(path.join(folder, `${page.name}.js`), script);
  await writeFile(path.join(folder, `${page.name}.css`), style);
  await writeFile(path.join(folder, page.policy), policy(script, style, page));
}

/** The Content-Security-Policy of a page that runs this script and style. */
function policy(script, style, { media, connect }) {
  const hash = (content) => `'sha256-${createHash('sha256').update(content).digest('base64')}'`;
  return [
    "default-src 'none'",
    `script-src ${hash(script)}`,
    `style-src ${hash(style)}`,
    'img-src data: blob:',
    `media-src ${media}`,
    `connect-src ${connect}`,
    "base-uri 'none'",
    "form-action 'none'",
  ].join('; ');
}

if (process.argv[1] === fileURLToPath(import.meta.url)) await buildInto(path.resolve(process.argv[2] ?? path.join(here, 'dist')));
