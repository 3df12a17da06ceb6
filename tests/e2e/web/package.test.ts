// The npm package, packed, installed in an empty folder, and its example in Chromium: what it draws is the mesh that the server has, also
// after an edit and after a flight.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { cpSync, existsSync, mkdtempSync, readFileSync, rmSync, symlinkSync, writeFileSync, writeSync } from 'node:fs';
import { createServer } from 'node:http';
import type { AddressInfo } from 'node:net';
import { tmpdir } from 'node:os';
import { extname, join } from 'node:path';
import { test } from 'node:test';
import type { Page } from 'playwright-core';
import type { Client, Triangles } from '../../../client/web/package/index';
import { PATIENCE, closeAll, launch, missing } from './browser';
import { Server, needed } from './server';

const folder = join(needed('RIDGECAST_WEB'), 'package');
const why = missing() || (existsSync(join(folder, 'dist/index.js')) ? '' : 'the package is not built; ./run build does that');
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

const TYPES: Record<string, string> = { '.html': 'text/html', '.js': 'text/javascript', '.wasm': 'application/wasm' };
const home = mkdtempSync(join(tmpdir(), 'ridgecast-package-'));
const files = createServer((request, response) => {
  const path = new URL(request.url!, 'http://x').pathname, file = join(home, path === '/' ? 'index.html' : path);
  if (!existsSync(file)) response.writeHead(404).end();
  else response.writeHead(200, { 'Content-Type': TYPES[extname(file)] ?? 'text/plain' }).end(readFileSync(file));
});
await new Promise<void>((done) => files.listen(0, '127.0.0.1', done));
const origin = `http://127.0.0.1:${(files.address() as AddressInfo).port}`;
const server = await Server.start(['--terrain', 'alpine', '--seed', '1', '--allow-origin', origin]), browser = await launch();
test.after(async () => {
  await closeAll();
  await server.stop();
  files.closeAllConnections();
  files.close();
  rmSync(home, { recursive: true, force: true });
});

interface Shown {
  camera: { position: { set(x: number, y: number, z: number): void; y: number } };
  controls: { target: { set(x: number, y: number, z: number): void } };
  client: Client;
  triangles: Triangles;
}
type Held = { shown: number; held: number; settled: boolean; worst: number; iteration: number };

/** What is drawn against what the core says: the number of triangles, and heights at their middles. */
const look = (page: Page): Promise<Held> =>
  page.evaluate(async () => {
    const { client, triangles } = (globalThis as unknown as { ridgecast: Shown }).ridgecast, { positions: p } = triangles, places: number[] = [], own: number[] = [];
    let shown = 0;
    for (let k = 0; k < p.length; k += 9) {
      if (p.subarray(k, k + 9).every((v) => v === 0)) continue;
      if (shown++ % 50 !== 0) continue;
      const middle = (c: number): number => (p[k + c]! + p[k + c + 3]! + p[k + c + 6]!) / 3;
      places.push(middle(0), middle(2));
      own.push(middle(1));
    }
    const { figures } = client, metres = await client.heights(places);
    return { shown, held: figures?.triangles ?? 0, settled: figures?.settled ?? false, iteration: figures?.iteration ?? 0, worst: Math.max(...own.map((y, k) => Math.abs(y - metres[k]!))) };
  });
async function atRest(page: Page): Promise<Held> {
  for (const end = Date.now() + PATIENCE; ; ) {
    const held = await look(page);
    if (held.settled && held.shown === held.held && held.worst < 0.5) return held;
    assert.ok(Date.now() < end, JSON.stringify(held));
    await page.waitForTimeout(200);
  }
}

test('is packed, installed elsewhere, and streams the mesh into three.js', async (t) => {
  const packed = execFileSync('npm', ['pack', '--silent', '--pack-destination', home], { cwd: folder }).toString().trim();
  writeFileSync(join(home, 'package.json'), '{ "private": true }');
  execFileSync('npm', ['install', '--silent', '--offline', '--no-audit', '--no-fund', `./${packed}`], { cwd: home });
  symlinkSync(join(needed('RIDGECAST_WEB'), 'node_modules/three'), join(home, 'node_modules/three'));
  cpSync(join(home, 'node_modules/ridgecast/example'), home, { recursive: true });
  assert.ok(existsSync(join(home, 'node_modules/ridgecast/dist/package/index.d.ts')));

  const page = await (await browser.newContext({ viewport: { width: 320, height: 200 } })).newPage(), complaints: string[] = [];
  page.setDefaultTimeout(PATIENCE);
  page.on('console', (message) => message.type() === 'error' && complaints.push(message.text()));
  page.on('pageerror', (error) => complaints.push(error.message));
  await page.goto(`${origin}/?server=${server.ws}`);
  await page.waitForFunction(() => 'ridgecast' in globalThis);
  const first = await atRest(page);
  assert.ok(first.held > 5000, JSON.stringify(first));
  if (process.env['PICTURE']) await page.screenshot({ path: process.env['PICTURE'] });

  const edited = await page.evaluate(async () => {
    const { client } = (globalThis as unknown as { ridgecast: Shown }).ridgecast, at = [0, -1500];
    const [before] = await client.heights(at), number = await client.edit({ op: 'crater', x: 0, z: -1500, radius: 60, depth: 30 });
    const refusal = await client.edit({ op: 'crater', x: 0, z: 0, radius: -1, depth: 1 }).then(() => '', (error: Error) => error.message);
    for (let after = before!; ; [after] = (await client.heights(at)) as unknown as [number]) {
      if (before! - after > 20) return { number, refusal, lower: before! - after };
      await new Promise((done) => setTimeout(done, 100));
    }
  });
  assert.equal(edited.number, 1);
  assert.match(edited.refusal, /radius/);
  const after = await atRest(page);

  await page.evaluate(() => {
    const { camera, controls } = (globalThis as unknown as { ridgecast: Shown }).ridgecast;
    camera.position.set(6000, 3500, -9000);
    controls.target.set(4000, 2000, -12_000);
  });
  await page.waitForFunction((n) => (globalThis as unknown as { ridgecast: Shown }).ridgecast.client.figures!.iteration > n, after.iteration);
  const far = await atRest(page);
  t.diagnostic(`${first.held}, then ${far.held} triangles; shown and held differ by ${far.worst.toFixed(3)} m at most; the crater is ${edited.lower.toFixed(1)} m deep`);
  assert.deepEqual(complaints, []);
});
