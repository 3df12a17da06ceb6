// The example page of MapLibre against the real server: no tile fails, and what it shows has the world's heights.

import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer, request } from 'node:http';
import { createRequire } from 'node:module';
import type { AddressInfo } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, test } from 'node:test';
import { PATIENCE, closeAll, launch } from './browser';
import { contrast, decodePng } from './picture';
import { Server, needed, sleep } from './server';

const examples = join(needed('RIDGECAST_WEB'), 'examples'), example = join(examples, 'maplibre');
const browser = process.env['CHROMIUM'] ?? '/usr/bin/chromium';
const missing = !existsSync(join(examples, 'node_modules/maplibre-gl')) ? 'npm ci in client/web/examples' : !existsSync(browser) ? `no ${browser}` : false;
if (missing) console.log(`SKIPPED: ${missing}`);
const AT = [11.39, 47.27] as const;

after(closeAll);

/** The page as `npm run dev` serves it: its own files, and /v1 handed on to the server. */
async function serve(server: Server): Promise<{ url: string; failed: string[]; tiles: number; close: () => void }> {
  const out = mkdtempSync(join(tmpdir(), 'ridgecast-maplibre-'));
  const { build } = createRequire(needed('RIDGECAST_WEB') + '/')('esbuild') as { build(options: object): Promise<unknown> };
  await build({ entryPoints: [join(example, 'main.js')], outdir: out, bundle: true, format: 'esm', logLevel: 'warning' });
  const state = { url: '', failed: [] as string[], tiles: 0, close: () => {} };
  const page = createServer((asked, answer) => {
    const path = (asked.url ?? '/').split('?')[0]!;
    if (path.startsWith('/v1/')) {
      const onward = request(`${server.http}${asked.url}`, { method: asked.method, headers: { host: asked.headers.host } }, (made) => {
        if (made.statusCode === 200) ++state.tiles;
        else state.failed.push(`${made.statusCode} ${asked.url}`);
        answer.writeHead(made.statusCode ?? 502, made.headers);
        made.pipe(answer);
      });
      onward.on('error', () => answer.destroy());
      answer.on('close', () => onward.destroy());
      onward.end();
      return;
    }
    const file = path === '/' ? join(example, 'index.html') : join(out, path.slice(1));
    if (!existsSync(file)) return void answer.writeHead(path === '/favicon.ico' ? 204 : 404).end();
    const type = file.endsWith('.html') ? 'text/html' : file.endsWith('.css') ? 'text/css' : 'text/javascript';
    let body = readFileSync(file, 'utf8');
    if (path === '/') body = body.replace('</head>', '<link rel="stylesheet" href="/main.css" /></head>');
    answer.writeHead(200, { 'Content-Type': type }).end(body);
  });
  await new Promise<void>((done) => page.listen(0, '127.0.0.1', done));
  state.url = `http://127.0.0.1:${(page.address() as AddressInfo).port}/`;
  state.close = () => {
    page.closeAllConnections();
    page.close();
    rmSync(out, { recursive: true, force: true });
  };
  return state;
}

interface Map {
  loaded(): boolean;
  areTilesLoaded(): boolean;
  jumpTo(to: { center: [number, number]; zoom: number }): void;
  queryTerrainElevation(at: [number, number]): number | null;
  getCenter(): { lng: number; lat: number };
}

const radius = 6378137, radians = Math.PI / 180, scale = Math.cos(AT[1] * radians);
const mercator = (latitude: number): number => radius * Math.asinh(Math.tan(latitude * radians));
type Place = [longitude: number, latitude: number];

/** The page shows the heights that the server has there by `questionOf`, and nothing fails. */
async function shows(args: string[], query: string, places: Place[], questionOf: (at: Place) => string): Promise<void> {
  const server = await Server.start(args);
  const site = await serve(server);
  try {
    const page = await (await (await launch()).newContext({ viewport: { width: 480, height: 270 } })).newPage();
    const errors: string[] = [];
    page.on('pageerror', (error) => errors.push(error.message));
    page.on('console', (message) => message.type() === 'error' && errors.push(message.text()));
    await page.goto(`${site.url}?${query}&picture`);
    const settled = async (): Promise<void> => {
      for (let k = 0; k < PATIENCE / 250; ++k) {
        await sleep(250);
        if (await page.evaluate(() => { const map = (globalThis as unknown as { map?: Partial<Map> }).map; return !!map?.loaded?.() && !!map.areTilesLoaded?.(); })) return;
      }
      throw new Error('the map did not load');
    };
    await settled();
    const shot = await page.screenshot();
    const keep = process.env['MAPLIBRE_PICTURE'];
    if (keep) writeFileSync(keep, shot);
    assert.ok(contrast(decodePng(shot)) > 10, 'a flat picture');
    for (const place of places) {
      await page.evaluate((center) => (globalThis as unknown as { map: Map }).map.jumpTo({ center, zoom: 15 }), place);
      await settled();
      const shown = await page.evaluate((at) => (globalThis as unknown as { map: Map }).map.queryTerrainElevation(at), place);
      const { heights } = (await (await fetch(`${server.http}/v1/heights?${questionOf(place)}`)).json()) as { heights: number[] };
      assert.ok(shown !== null && Math.abs(shown - heights[0]!) < 15, `${shown} m shown, ${heights[0]} m there`); // between samples some 10 m apart
    }
    assert.deepEqual(site.failed, []);
    assert.deepEqual(errors, []);
    assert.ok(site.tiles > 20, `${site.tiles} tiles`);
  } finally {
    site.close();
    await server.stop();
  }
}

// Places of the world, by the formula of server/map/mercator.h.
test('MapLibre shows the hills', { skip: missing, timeout: 10 * PATIENCE }, () =>
  shows(['--terrain', 'alpine', '--seed', '1'], `at=${AT}`, ([[0, 0], [0.011, 0.004], [-0.02, 0.013]] as const).map(([dx, dy]) => [AT[0] + dx, AT[1] + dy]), ([longitude, latitude]) =>
    `at=${radius * (longitude - AT[0]) * radians * scale},${-(mercator(latitude) - mercator(AT[1])) * scale}`));

test('MapLibre shows a map where it lies, without being told', { skip: missing, timeout: 10 * PATIENCE }, async () => {
  const folder = mkdtempSync(join(tmpdir(), 'ridgecast-map-')), map = join(folder, 'hills.asc');
  const samples = Array.from({ length: 400 * 400 }, (_, k) => Math.round(1000 + (k % 400) + 300 * Math.sin((k % 400) / 40) * Math.cos(k / 16000))).join(' ');
  writeFileSync(map, `ncols 400\nnrows 400\nxllcorner 680000\nyllcorner 5240000\ncellsize 20\n${samples}\n`);
  writeFileSync(join(folder, 'hills.prj'), 'PROJCS["a",GEOGCS["b",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]]');
  try {
    await shows(['--terrain', map], '', [[11.43, 47.32], [11.405, 47.3], [11.46, 47.345]], ([longitude, latitude]) => `crs=lonlat&at=${longitude},${latitude}`);
  } finally {
    rmSync(folder, { recursive: true });
  }
});
