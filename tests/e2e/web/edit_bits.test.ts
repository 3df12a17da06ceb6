// Edited ground has the same bits in the browser's shaders (SwiftShader's here) as on the server: 100,000 places after 1,000 operations.

import assert from 'node:assert/strict';
import { readFileSync, writeSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { test } from 'node:test';
import { Core } from '../../../client/web/src/core/core';
import { Line } from '../../../client/web/src/engine/line';
import type { EditSquare } from '../../../client/web/src/messages';
import { closeAll, launch, missing } from './browser';
import type { Answer, Question } from './edited_heights';
import { NodeSocket } from './node_socket';
import { randomFrom } from './random';
import { Server, needed, sleep } from './server';
import { parts } from '../../support/web';

const why = missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

const STEPS = 256;
const OPERATIONS = Number(process.env['OPERATIONS'] ?? 300);
// Samples lie an even number of steps apart whose half is odd: from middles of both parities, they fall between posts in every way.
const SIDE = 160, APART = 2 * 137;

const server = await Server.start(['--terrain', 'alpine', '--seed', '1']);
test.after(async () => {
  await closeAll();
  await server.stop();
});

/** The page's own modules, bundled with the shaders as vite does. */
async function bundle(): Promise<string> {
  const { build } = createRequire(needed('RIDGECAST_WEB') + '/')('esbuild') as typeof import('esbuild');
  const { outputFiles } = await build({
    entryPoints: [join(needed('RIDGECAST_SOURCE'), 'tests/e2e/web/edited_heights.ts')],
    bundle: true,
    write: false,
    format: 'iife',
    nodePaths: [join(needed('RIDGECAST_WEB'), 'node_modules')],
    logLevel: 'warning',
    plugins: [
      {
        name: 'raw',
        setup(builder) {
          builder.onResolve({ filter: /\?raw$/ }, ({ path, resolveDir }) => ({ path: join(resolveDir, path.replace('?raw', '')), namespace: 'raw' }));
          builder.onLoad({ filter: /.*/, namespace: 'raw' }, ({ path }) => ({ contents: readFileSync(path, 'utf8'), loader: 'text' }));
        },
      },
    ],
  });
  return outputFiles[0]!.text;
}

type Between = (low: number, high: number) => number;

function randomOperation(random: Between, middle: { x: number; z: number }, made: number): object {
  const whole = (low: number, high: number): number => Math.floor(random(low, high));
  const near = (v: number): number => v + whole(-60 * STEPS, 60 * STEPS) / STEPS;
  const at = (): { x: number; z: number } => ({ x: near(middle.x), z: near(middle.z) });
  const pair = (): [number, number] => [near(middle.x), near(middle.z)];
  const materials = ['earth', 'rock', 'gravel', 'sand', 'grass', 'asphalt', 'concrete', 'snow'];
  const material = random(0, 1) < 0.5 ? {} : { material: materials[whole(0, 8)] };
  if (made % 50 === 49) return { op: 'undo', edit: 1 + whole(0, made) };
  switch (whole(0, 8)) {
    case 0:
      return { op: 'raise', ...at(), radius: random(1, 20), by: random(0.1, 9), ...material };
    case 1:
      return { op: 'lower', ...at(), radius: random(1, 20), by: random(0.1, 9), ...material };
    case 2:
      return { op: 'crater', ...at(), radius: random(1, 20), depth: random(0.1, 9), ...material };
    case 3:
      return { op: 'level', ...at(), radius: random(1, 15), height: random(900, 1100), slope: random(0.1, 2), ...material };
    case 4:
      return { op: 'level', polygon: [pair(), pair(), pair(), pair()], height: random(900, 1100), ...material };
    case 5:
      return { op: 'smooth', ...at(), radius: random(1, 20), passes: whole(1, 17), ...material };
    case 6:
      return { op: 'road', line: [pair(), pair(), pair()], width: random(1, 10), ...material };
    default:
      return { op: 'stamp', ...at(), spacing: whole(1, 9) / 2, columns: 5, samples: Array.from({ length: 20 }, () => random(-3, 3)), ...material };
  }
}

async function post(path: string, type: string, body: string | Uint8Array): Promise<Response> {
  return fetch(server.http + path, { method: 'POST', headers: { 'Content-Type': type }, body: body as BodyInit });
}

/** Metres at places, as the server's processor computes them. */
async function heightsAt(world: string, places: Float64Array): Promise<Uint32Array> {
  const answer = await post(`/v1/heights?${world}`, 'application/octet-stream', new Uint8Array(places.buffer));
  assert.equal(answer.status, 200, await answer.clone().text());
  return new Uint32Array(await answer.arrayBuffer());
}

/** What the page's core holds of the edits around a place, fetched from the server. */
async function hold(world: string, at: { x: number; z: number }): Promise<{ source: string; seed: number; squares: EditSquare[] }> {
  const { core: module, draco } = await parts(), held = new Map<string, EditSquare>();
  return new Promise((resolve, reject) => {
    let source = '', seed = 0;
    const core: Core = new Core(module, draco, {
      dial: (elsewhere, showsToken) => line.dial(elsewhere, showsToken),
      send: (frame) => line.send(frame),
      hangUp: (why) => line.hangUp(why),
      tell: (message) => {
        if (message.kind !== 'figures' || !message.figures.settled) return;
        line.close();
        resolve({ source, seed, squares: [...held.values()] });
      },
      paint: (message) => {
        if (message.kind === 'world') ({ source, seed } = message);
        if (message.kind === 'squares') {
          for (const key of message.gone) held.delete(key);
          for (const square of message.fresh) held.set(square.key, square);
        }
        if (message.kind === 'squares' || message.kind === 'change') setTimeout(() => (core.taken(), line.go()));
      },
    });
    const line = new Line(core, { open: () => new NodeSocket(`${server.ws}/v1/stream?${world}`), onLost: ({ sentence }) => reject(new Error(sentence)) });
    core.start(new URL(server.http).host, 'test', 16);
    core.pose({ ...at, y: 3000, yaw: 0, pitch: -1, verticalFov: 1, width: 320, height: 180 }, 1);
    line.go();
  });
}

const script = await bundle();
const browser = await launch();

for (const { terrain, x, z, operations } of [
  { terrain: 'alpine', x: 0, z: 0, operations: OPERATIONS },
  { terrain: 'canyon', x: 1e9, z: -1e9, operations: 100 },
])
  test(`${terrain} around (${x}, ${z}) after ${operations} operations`, async (t) => {
    const world = `session=${terrain}&terrain=${terrain}&seed=1`, random = randomFrom(operations), middle = { x, z };
    const grids = Array.from({ length: 4 }, (_, k) => ({ x: x * STEPS + 2 * Math.floor(random(-2000, 2000)) + (k & 1), z: z * STEPS + 2 * Math.floor(random(-2000, 2000)) + (k >> 1) }));
    const places = grids.map((grid) => {
      const out = new Float64Array(2 * SIDE * SIDE), step = (k: number): number => ((2 * k + 1 - SIDE) * APART) / 2;
      for (let k = 0; k < SIDE * SIDE; ++k) {
        out[2 * k] = (grid.x + step(k % SIDE)) / STEPS;
        out[2 * k + 1] = (grid.z + step(Math.floor(k / SIDE))) / STEPS;
      }
      return out;
    });
    const before = [];
    for (const grid of places) before.push(await heightsAt(world, grid)); // which makes the session, too
    for (let made = 0, refused = 0; made < operations; ) {
      const answer = await post(`/v1/sessions/${terrain}/edits`, 'application/json', JSON.stringify(randomOperation(random, middle, made)));
      if (answer.status === 201) ++made;
      else if (answer.status === 429) await sleep(100);
      else assert.ok(answer.status < 500 && ++refused < operations, await answer.text());
    }
    const after = [];
    for (const grid of places) after.push(await heightsAt(world, grid));

    const { source, seed, squares } = await hold(world, grids[0]!);
    const context = await browser.newContext(), page = await context.newPage();
    await page.addScriptTag({ content: script });
    const draw = (posts: EditSquare[]): Promise<Answer> =>
      page.evaluate((question) => (globalThis as unknown as { editedHeights(q: Question): Promise<Answer> }).editedHeights(question), {
        source, seed, grids, side: SIDE, spacing: APART / STEPS, squares: posts.map((square) => ({ ...square, posts: [...square.posts] })),
      } satisfies Question);
    const different = (bits: ArrayLike<number>[], others: Uint32Array[]): number => bits.reduce((sum, grid, g) => sum + [...others[g]!].filter((v, k) => v !== grid[k]).length, 0);
    const edited = await draw(squares), changed = different(after, before);
    t.diagnostic(`${edited.renderer}; ${squares.length} squares, ${changed} of ${4 * SIDE * SIDE} heights are edited`);
    assert.ok(changed > SIDE * SIDE);
    assert.equal(different(edited.bits, after), 0, 'heights of edited ground differ');
    assert.equal(different((await draw([])).bits, before), 0, 'heights without edits differ');
    await context.close();
  });
