/**
 * Builds what `etude replay` puts into its pages: the script, the style sheet, and the policy that lets nothing else
 * run. The same sources give the same bytes.
 *
 *     node build.mjs [FOLDER]      (default: dist)
 */

import { createHash } from 'node:crypto';
import { mkdir, writeFile } from 'node:fs/promises';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

import { build } from 'esbuild';

const here = path.dirname(fileURLToPath(import.meta.url));

/** Builds into `folder`. */
export async function buildInto(folder) {
  const { outputFiles } = await build({
    absWorkingDir: here,
    entryPoints: [{ in: 'src/main.js', out: 'replay' }, { in: 'src/page.css', out: 'replay' }],
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
  await mkdir(folder, { recursive: true });
  await writeFile(path.join(folder, 'replay.js'), script);
  await writeFile(path.join(folder, 'replay.css'), style);
  await writeFile(path.join(folder, 'csp.txt'), policy(script, style));
}

/** The Content-Security-Policy of a page that runs this script and style, and fetches nothing. */
function policy(script, style) {
  const hash = (content) => `'sha256-${createHash('sha256').update(content).digest('base64')}'`;
  return [
    "default-src 'none'",
    `script-src ${hash(script)}`,
    `style-src ${hash(style)}`,
    'img-src data: blob:',
    'media-src data: blob:',
    "connect-src 'none'",
    "base-uri 'none'",
    "form-action 'none'",
  ].join('; ');
}

if (process.argv[1] === fileURLToPath(import.meta.url)) await buildInto(path.resolve(process.argv[2] ?? path.join(here, 'dist')));
