// The example pages with the real server: no tile fails, and in random views no background shines through below the horizon. VIEWS is their
// number in each page, FLIGHT the seconds that it then flies, TERRAIN another world, such as a GeoTIFF; a release is judged with
// 1,000 views and 300 seconds, of alpine and of a map.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeSync } from 'node:fs';
import { createServer as createFileServer } from 'node:http';
import type { AddressInfo } from 'node:net';
import { tmpdir } from 'node:os';
import { join, normalize } from 'node:path';
import { test } from 'node:test';
import type { Page } from 'playwright-core';
import { PATIENCE, closeAll, launch, missing } from './browser';
import { randomFrom } from './random';
import { Server, environment, needed, sleep } from './server';
import { missingExamples, serveExamples } from './vite';

const why = missingExamples() || missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

const VIEWS = Number(process.env['VIEWS'] ?? 3);
const FLIGHT = Number(process.env['FLIGHT'] ?? 5);
const SIZE = { width: 320, height: 200 };
const GLARING = { background: '#ff00ff', error: '16' };

interface View {
  east: number;
  north: number;
  up: number;
  heading: number;
  pitch: number;
}

const browser = await launch();
const server = await Server.start(['--terrain', process.env['TERRAIN'] ?? 'alpine', '--seed', '1']);
const { url, child } = await serveExamples(server);
test.afterEach(async () => {
  for (const context of browser.contexts()) await context.close();
});
test.after(async () => {
  child.kill();
  await closeAll();
  await server.stop();
});

async function heights(places: [number, number][]): Promise<number[]> {
  const answer = await fetch(`${server.http}/v1/heights?${places.map(([x, z]) => `at=${x},${z}`).join('&')}`);
  return ((await answer.json()) as { heights: number[] }).heights;
}

async function materials(places: [number, number][]): Promise<(string | null)[]> {
  const answer = await fetch(`${server.http}/v1/materials?${places.map(([x, z]) => `at=${x},${z}`).join('&')}`);
  return ((await answer.json()) as { materials: (string | null)[] }).materials;
}

const random = randomFrom(17);

/** A view from 3 m to 3 km above the ground, up to 20 km from the middle. */
async function randomView(): Promise<View> {
  const east = random(-20_000, 20_000), north = random(-20_000, 20_000);
  const [ground] = await heights([[east, -north]]);
  return { east, north, up: ground! + 3 * 1000 ** random(0, 1), heading: random(0, 360), pitch: random(-60, 0) };
}

async function open(path: string, more: Record<string, string> = {}): Promise<Page> {
  const page = await (await browser.newContext({ viewport: SIZE })).newPage();
  page.setDefaultTimeout(10 * PATIENCE);
  await page.goto(`${url}${path}?${new URLSearchParams({ ...GLARING, ...more }).toString()}`);
  await page.waitForFunction(() => 'ridgecast' in globalThis);
  return page;
}

/** What a page is asked: it draws, and says whether all is there; and it draws, and says where the picture is. */
interface Asked {
  settled: string;
  drawn: string;
}
const THREE: Asked = {
  settled: 'ridgecast.draw(), (({ downloading, parsing, visible }) => visible > 0 && downloading + parsing === 0)(ridgecast.tiles.stats)',
  drawn: '(ridgecast.draw(), { gl: ridgecast.renderer.getContext(), tangent: Math.tan(Math.PI / 6), up: ridgecast.camera.matrixWorld.elements[5], forward: -ridgecast.camera.matrixWorld.elements[9] })',
};
const CESIUM: Asked = {
  // Not scene.render(), which leaves it to others to see that the camera moves: Cesium requests nothing in the two frames after that.
  settled: 'ridgecast.viewer.render(), ridgecast.tileset.tilesLoaded',
  drawn: `(() => {
    const { viewer, scene, frame, Cesium } = ridgecast, camera = scene.camera;
    viewer.render();
    const up = new Cesium.Cartesian3(frame[8], frame[9], frame[10]), along = (v) => Cesium.Cartesian3.dot(v, up);
    const gl = scene.canvas.getContext('webgl2');
    return { gl, tangent: Math.tan(camera.frustum.fovy / 2), up: along(camera.upWC), forward: along(camera.directionWC) };
  })()`,
};

/** Looks, waits until all is there, and counts background pixels 3 degrees and more below the horizontal, where there is only ground. */
async function background(page: Page, view: View, { settled, drawn }: Asked): Promise<number> {
  await page.evaluate(`ridgecast.look(${view.east}, ${view.north}, ${view.up}, ${view.heading}, ${view.pitch})`);
  for (let calm = 0; calm < 3; await sleep(100)) calm = (await page.evaluate(settled)) ? calm + 1 : 0;
  // Pixels from below, 4 bytes each, and the upright, right and forward axes' vertical parts, of a view 60 degrees high (or wide).
  return page.evaluate(`(() => {
    const { gl, up, forward, tangent } = ${drawn};
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl, pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let count = 0;
    for (let y = 0; y < height; ++y)
      for (let x = 0; x < width; ++x) {
        const a = ((2 * x + 1) / width - 1) * tangent * width / height, b = ((2 * y + 1) / height - 1) * tangent;
        const below = (forward + b * up) / Math.hypot(1, a, b) < -Math.sin(3 * Math.PI / 180);
        const k = 4 * (y * width + x);
        if (below && pixels[k] > 200 && pixels[k + 1] < 60 && pixels[k + 2] > 200) ++count;
      }
    return count;
  })()`);
}

async function assertWhole(page: Page, view: View, asked: Asked, when?: string): Promise<void> {
  const holes = await background(page, view, asked);
  assert.deepEqual(await page.evaluate('ridgecast.failed'), [], when);
  assert.equal(holes, 0, JSON.stringify(view));
}

async function fly(page: Page, asked: Asked): Promise<void> {
  for (let k = 0; k < VIEWS; ++k) await assertWhole(page, await randomView(), asked);
}

/** Flies on and on in bends, 60 m at a time, without waiting for tiles; round and round, for a tileset ends somewhere. */
async function cruise(page: Page, asked: Asked): Promise<void> {
  let view = { ...(await randomView()), pitch: -15 }, steps = 0;
  for (const end = Date.now() + 1000 * FLIGHT; Date.now() < end; ++steps) {
    const heading = view.heading + 2 * Math.cos(steps / 40) + steps / 100, east = view.east + 60 * Math.sin((heading * Math.PI) / 180), north = view.north + 60 * Math.cos((heading * Math.PI) / 180);
    const [ground] = await heights([[east, -north]]);
    view = { ...view, east, north, heading, up: ground! + 300 };
    await page.evaluate(`ridgecast.look(${view.east}, ${view.north}, ${view.up}, ${view.heading}, ${view.pitch}); void (${asked.settled})`);
  }
  await assertWhole(page, view, asked, `of ${steps} steps`);
}

test('three.js shows ground wherever there is ground', { timeout: 1000 * PATIENCE }, async () => {
  const page = await open('/three/');
  await fly(page, THREE);
  await cruise(page, THREE);
  // The glaring background is found where it is.
  await page.evaluate('ridgecast.tiles.group.visible = false');
  assert.ok((await background(page, { east: 0, north: 0, up: 3000, heading: 0, pitch: -30 }, { ...THREE, settled: 'true' })) > 1000);
});

test('three.js says what the ground is made of', { timeout: 100 * PATIENCE, skip: 'TERRAIN' in process.env && 'a map says it by its classes, if at all' }, async () => {
  const page = await open('/three/');
  const found = new Set<string>();
  for (let tries = 0; found.size < 3 && tries < 200; ++tries) {
    const east = random(-5000, 5000), north = random(-5000, 5000);
    const around = [-40, 0, 40].flatMap((x) => [-40, 0, 40].map((z): [number, number] => [east + x, z - north]));
    const [name, ...others] = await materials(around);
    if (!name || found.has(name) || others.some((other) => other !== name)) continue;
    const [ground] = await heights([[east, -north]]);
    await assertWhole(page, { east, north, up: ground! + 100, heading: 0, pitch: -90 }, THREE);
    await page.mouse.click(SIZE.width / 2, SIZE.height / 2);
    assert.equal(await page.textContent('#ground'), name, `${east}, ${north}`);
    found.add(name);
  }
  assert.equal(found.size, 3, [...found].join(', '));
  await page.evaluate('ridgecast.look(0, 0, 9000, 0, 60), ridgecast.draw()');
  assert.equal(await page.evaluate('ridgecast.groundAt(100, 20)'), '', 'the sky is made of nothing');
});

test('three.js shows a folder of tiles from any file server', { timeout: 10 * PATIENCE, skip: 'TERRAIN' in process.env && 'a map in UTM lies on Earth, far from the origin' }, async (t) => {
  const folder = mkdtempSync(join(tmpdir(), 'ridgecast-tiles-'));
  execFileSync(needed('RIDGECAST_CLIENT'), ['snapshot', '--terrain', 'alpine', '--box', '-2000,-2000,2000,2000', '--error', '6', '--tiles', join(folder, 'tiles')], { env: environment() });
  const files = createFileServer((request, response) => {
    const file = join(folder, normalize(request.url ?? '/'));
    response.writeHead(existsSync(file) ? 200 : 404, { 'Access-Control-Allow-Origin': '*' });
    response.end(existsSync(file) ? readFileSync(file) : '');
  }).listen(0, '127.0.0.1');
  t.after(() => {
    files.close();
    rmSync(folder, { recursive: true });
  });
  await new Promise((done) => files.once('listening', done));
  const page = await open('/three/', { tileset: `http://127.0.0.1:${(files.address() as AddressInfo).port}/tiles/tileset.json` });
  for (let k = 0; k < VIEWS; ++k) {
    const east = random(-300, 300), north = random(-300, 300); // so that the box fills the view
    const [ground] = await heights([[east, -north]]);
    await assertWhole(page, { east, north, up: ground! + random(50, 300), heading: random(0, 360), pitch: random(-90, -85) }, THREE);
  }
  assert.ok((await background(page, { east: 9000, north: 0, up: 3000, heading: 0, pitch: -90 }, { ...THREE, settled: 'true' })) > 1000, 'there is nothing beyond the box');
});

test('CesiumJS shows ground wherever there is ground, at its height', { timeout: 1000 * PATIENCE }, async () => {
  const page = await open('/cesium/');
  await fly(page, CESIUM);
  await cruise(page, CESIUM);
  const places: [number, number][] = Array.from({ length: 5 }, () => [random(-300, 300), random(-300, 300)]);
  const found = (await page.evaluate(`(async () => {
    const { Cesium, frame, scene } = ridgecast;
    const places = ${JSON.stringify(places)}.map(([x, z]) => Cesium.Cartographic.fromCartesian(Cesium.Matrix4.multiplyByPoint(frame, new Cesium.Cartesian3(x, -z, 0), new Cesium.Cartesian3())));
    return (await scene.sampleHeightMostDetailed(places)).map((place) => place.height);
  })()`)) as number[];
  const truth = await heights(places);
  found.forEach((height, k) => assert.ok(Math.abs(height - truth[k]!) <= 0.4 + 0.3, `${height} instead of ${truth[k]}`)); // Cesium's depth has its own error
});

for (const [path, asked] of [['/three/', THREE], ['/cesium/', CESIUM]] as const)
  test(`${path} asks again for what a busy server refuses`, { timeout: 10 * PATIENCE }, async () => {
    const page = await open(path), refused = new Set<string>();
    await page.route(/3dtiles.*\.glb/, async (route) => {
      const url = route.request().url();
      if (refused.has(url)) return route.continue();
      refused.add(url);
      return route.fulfill({ status: 503, headers: { 'Retry-After': '1' } });
    });
    await assertWhole(page, await randomView(), asked);
    assert.ok(refused.size > 0);
  });
