// The example page of MapLibre against the real server: no tile fails, and what it shows has the world's heights.

import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync, writeSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, test } from 'node:test';
import { PATIENCE, closeAll, launch, missing } from './browser';
import { contrast, decodePng } from './picture';
import { Server, sleep } from './server';
import { missingExamples, serveExamples } from './vite';

const why = missingExamples() || missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}
const AT = [11.39, 47.27] as const;

const browser = await launch();
after(closeAll);

interface Map {
  loaded(): boolean;
  areTilesLoaded(): boolean;
  setLayoutProperty(layer: string, name: string, value: string): void;
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
  const site = await serveExamples(server);
  try {
    const page = await (await browser.newContext({ viewport: { width: 240, height: 135 } })).newPage();
    const errors: string[] = [];
    let tiles = 0;
    page.on('response', (answer) => {
      if (/\/v1\/.*\d\.(png|jpg)/.test(answer.url())) ++tiles;
      if (answer.status() >= 400) errors.push(`${answer.status()} ${answer.url()}`);
    });
    page.on('pageerror', (error) => errors.push(error.message));
    page.on('console', (message) => message.type() === 'error' && errors.push(message.text()));
    await page.goto(`${site.url}/maplibre/?${query}&picture`);
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
    // The heights alone from here on: drawing in software takes most of the time.
    await page.evaluate(() => ['colours', 'relief'].forEach((layer) => (globalThis as unknown as { map: Map }).map.setLayoutProperty(layer, 'visibility', 'none')));
    for (const place of places) {
      await page.evaluate((center) => (globalThis as unknown as { map: Map }).map.jumpTo({ center, zoom: 15 }), place);
      await settled();
      const shown = await page.evaluate((at) => (globalThis as unknown as { map: Map }).map.queryTerrainElevation(at), place);
      const { heights } = (await (await fetch(`${server.http}/v1/heights?${questionOf(place)}`)).json()) as { heights: number[] };
      assert.ok(shown !== null && Math.abs(shown - heights[0]!) < 15, `${shown} m shown, ${heights[0]} m there`); // between samples some 10 m apart
    }
    assert.deepEqual(errors, []);
    assert.ok(tiles > 20, `${tiles} tiles`);
  } finally {
    site.child.kill();
    await server.stop();
  }
}

// Places of the world, by the formula of server/map/mercator.h.
test('MapLibre shows the hills', { timeout: 10 * PATIENCE }, () =>
  shows(['--terrain', 'alpine', '--seed', '1'], `at=${AT}`, ([[0, 0], [-0.02, 0.013]] as const).map(([dx, dy]) => [AT[0] + dx, AT[1] + dy]), ([longitude, latitude]) =>
    `at=${radius * (longitude - AT[0]) * radians * scale},${-(mercator(latitude) - mercator(AT[1])) * scale}`));

test('MapLibre shows a map where it lies, without being told', { timeout: 10 * PATIENCE }, async () => {
  const folder = mkdtempSync(join(tmpdir(), 'ridgecast-map-')), map = join(folder, 'hills.asc');
  const samples = Array.from({ length: 400 * 400 }, (_, k) => Math.round(1000 + (k % 400) + 300 * Math.sin((k % 400) / 40) * Math.cos(k / 16000))).join(' ');
  writeFileSync(map, `ncols 400\nnrows 400\nxllcorner 680000\nyllcorner 5240000\ncellsize 20\n${samples}\n`);
  writeFileSync(join(folder, 'hills.prj'), 'PROJCS["a",GEOGCS["b",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]]');
  try {
    await shows(['--terrain', map], '', [[11.43, 47.32], [11.46, 47.345]], ([longitude, latitude]) => `crs=lonlat&at=${longitude},${latitude}`);
  } finally {
    rmSync(folder, { recursive: true });
  }
});
