// Other viewers along a flight, for `ridgecast-bench doors` (doors.cpp): 3D Tiles in 3d-tiles-renderer, Terrarium heights in MapLibre.
// Reads a plan (DOORS_PLAN) and writes what was shown (DOORS_SHOWN), both JSON. Nothing is measured here: heights are only told.

import { readFileSync, writeFileSync } from 'node:fs';
import type { Page } from 'playwright-core';
import { closeAll, launch } from '../e2e/web/browser';
import { needed } from '../e2e/web/server';
import { serveExamples } from '../e2e/web/vite';

interface Pose {
  t: number; // seconds of flight
  x: number; // metres, +z south
  y: number;
  z: number;
  yaw: number; // radians, + left
  pitch: number;
  places?: [x: number, z: number][]; // where heights are wanted
}
interface Plan {
  viewer: 'three' | 'maplibre';
  http: string;
  query: string; // of the viewer's page or source
  detail: number; // three: pixels of error; maplibre: pixels that a tile of 256 samples stands for
  fov: number; // radians
  width: number;
  height: number;
  patience: number; // seconds for the first picture
  poses: Pose[];
}
type Heights = (number | null)[];
interface Shown {
  requests: number;
  began: number; // the flight, seconds since 1970
  first: { t: number; heights: Heights }[]; // seconds since the first question, until all is there
  flight: { t: number; heights: Heights }[];
}

/** What the page of either viewer offers as `door`. */
interface Door {
  begin(): void; // looks already
  look(pose: Pose): void;
  isLoading(): boolean;
  record(places: [number, number][]): () => Heights; // of what is shown now, to be looked at later
}

/** Of 3d-tiles-renderer: the triangles of visible tiles, by places. Runs in the page. */
function threeDoor(): Door {
  interface Matrix {
    elements: number[];
    clone(): Matrix;
    premultiply(by: Matrix): Matrix;
  }
  interface Mesh {
    name: string;
    parent: Mesh | null;
    matrixWorld: Matrix;
    geometry?: { index: { array: ArrayLike<number> } | null; attributes: { position: { count: number; getX(k: number): number; getY(k: number): number; getZ(k: number): number } } };
    traverse(each: (mesh: Mesh) => void): void;
    updateMatrixWorld(force: boolean): void;
  }
  interface Tiles {
    stats: { downloading: number; parsing: number; visible: number };
    visibleTiles: Set<object>;
    group: Mesh;
    addEventListener(name: string, hear: (event: { scene: Mesh; tile: object }) => void): void;
  }
  const { tiles, renderer, look, draw } = (globalThis as unknown as { ridgecast: { tiles: Tiles; renderer: { render(): void; setAnimationLoop(loop: null): void }; draw(): void; look(east: number, north: number, up: number, heading: number, pitch: number): void } }).ridgecast;
  renderer.render = () => {}; // what is shown counts, and drawing it in software would take the time of everything else
  const SIDE = 32;
  interface Ground {
    x: Float64Array;
    y: Float64Array;
    z: Float64Array;
    low: [number, number];
    size: [number, number];
    bins: number[][]; // the first corners of the triangles over each
  }
  const groundOf = (scene: Mesh): Ground => {
    const x: number[] = [], y: number[] = [], z: number[] = [];
    scene.updateMatrixWorld(true);
    scene.traverse((mesh) => {
      const { geometry } = mesh;
      if (!geometry || mesh.name === 'skirt' || mesh.parent?.name === 'skirt') return;
      const { position } = geometry.attributes, world = mesh.matrixWorld.clone(), m = (scene.parent ? world : world.premultiply(tiles.group.matrixWorld)).elements, index = geometry.index?.array;
      for (let k = 0; k < (index?.length ?? position.count); ++k) {
        const v = index ? index[k]! : k, a = position.getX(v), b = position.getY(v), c = position.getZ(v);
        x.push(m[0]! * a + m[4]! * b + m[8]! * c + m[12]!);
        y.push(m[1]! * a + m[5]! * b + m[9]! * c + m[13]!);
        z.push(m[2]! * a + m[6]! * b + m[10]! * c + m[14]!);
      }
    });
    const least = (v: number[]): number => v.reduce((s, e) => Math.min(s, e), Infinity), most = (v: number[]): number => v.reduce((s, e) => Math.max(s, e), -Infinity);
    const low: [number, number] = [least(x), least(z)], size: [number, number] = [most(x) - low[0], most(z) - low[1]];
    const bins = Array.from({ length: SIDE * SIDE }, (): number[] => []), bin = (v: number, axis: 0 | 1): number => Math.min(SIDE - 1, Math.max(0, Math.floor(((v - low[axis]) / size[axis]) * SIDE)));
    for (let k = 0; k < x.length; k += 3) {
      const xs = [x[k]!, x[k + 1]!, x[k + 2]!], zs = [z[k]!, z[k + 1]!, z[k + 2]!];
      for (let row = bin(Math.min(...zs), 1); row <= bin(Math.max(...zs), 1); ++row)
        for (let column = bin(Math.min(...xs), 0); column <= bin(Math.max(...xs), 0); ++column) bins[row * SIDE + column]!.push(k);
    }
    return { x: Float64Array.from(x), y: Float64Array.from(y), z: Float64Array.from(z), low, size, bins };
  };
  const heightAt = ({ x, y, z, low, size, bins }: Ground, px: number, pz: number): number | undefined => {
    const u = (px - low[0]) / size[0], v = (pz - low[1]) / size[1];
    if (!(u >= 0 && u <= 1 && v >= 0 && v <= 1)) return undefined;
    for (const k of bins[Math.min(SIDE - 1, Math.floor(v * SIDE)) * SIDE + Math.min(SIDE - 1, Math.floor(u * SIDE))]!) {
      const ax = x[k]!, az = z[k]!, bx = x[k + 1]! - ax, bz = z[k + 1]! - az, cx = x[k + 2]! - ax, cz = z[k + 2]! - az, area = bx * cz - bz * cx;
      if (area === 0) continue;
      const s = ((px - ax) * cz - (pz - az) * cx) / area, t = (bx * (pz - az) - bz * (px - ax)) / area, slack = -1e-6;
      if (s >= slack && t >= slack && s + t <= 1 - slack) return y[k]! + s * (y[k + 1]! - y[k]!) + t * (y[k + 2]! - y[k]!);
    }
    return undefined;
  };
  const grounds = new Map<object, () => Ground>(); // made when somebody looks
  tiles.addEventListener('load-model', ({ scene, tile }) => {
    let ground: Ground | undefined;
    grounds.set(tile, () => (ground ??= groundOf(scene)));
  });
  return {
    begin: () => {},
    look: ({ x, y, z, yaw, pitch }) => {
      look(x, -z, y, (-yaw * 180) / Math.PI, (pitch * 180) / Math.PI);
      draw();
    },
    isLoading: () => (draw(), tiles.stats.visible === 0 || tiles.stats.downloading + tiles.stats.parsing > 0),
    record: (places) => {
      const shown = [...tiles.visibleTiles].flatMap((tile) => grounds.get(tile) ?? []);
      return () => {
        const all = shown.map((ground) => ground());
        return places.map(([x, z]) => {
          for (const ground of all) {
            const y = heightAt(ground, x, z);
            if (y !== undefined) return y;
          }
          return null;
        });
      };
    },
  };
}

/** Of MapLibre: the mesh of each tile that it draws, as its shader makes it (Terrain.getTerrainMesh). Runs in the page. */
function maplibreDoor(): Door {
  interface Tile {
    tileID: { canonical: { x: number; y: number; z: number } };
  }
  interface Map {
    jumpTo(options: object): void;
    calculateCameraOptionsFromCameraLngLatAltRotation(at: [number, number], altitude: number, bearing: number, pitch: number, roll: number): object;
    loaded(): boolean;
    areTilesLoaded(): boolean;
    terrain?: {
      meshSize: number;
      sourceCache: { getRenderableTiles(): Tile[]; getSourceTile(id: Tile['tileID'], orLess: boolean): { dem?: object } | undefined };
      getElevation(id: Tile['tileID'], x: number, y: number): number;
    };
  }
  const { map, begin } = globalThis as unknown as { map: Map; begin(): void };
  // server/map/mercator.h
  const AT = [11.39, 47.27] as const, radius = 6378137, radians = Math.PI / 180, scale = Math.cos(AT[1] * radians);
  const placeOf = (x: number, z: number): [number, number] => {
    const north = Math.asinh(Math.tan(AT[1] * radians)) - z / radius / scale;
    return [AT[0] + x / radius / scale / radians, Math.atan(Math.sinh(north)) / radians];
  };
  const EXTENT = 8192;
  const heightAt = (tiles: Tile[], [longitude, latitude]: [number, number]): number | null => {
    const { sourceCache, meshSize } = map.terrain!, x = (longitude + 180) / 360, y = (1 - Math.asinh(Math.tan(latitude * radians)) / Math.PI) / 2;
    let found: { id: Tile['tileID']; u: number; v: number } | undefined;
    for (const { tileID: id } of tiles) {
      const u = x * 2 ** id.canonical.z - id.canonical.x, v = y * 2 ** id.canonical.z - id.canonical.y;
      if (u >= 0 && u < 1 && v >= 0 && v < 1 && !(found && found.id.canonical.z > id.canonical.z)) found = { id, u, v };
    }
    if (!found || !sourceCache.getSourceTile(found.id, true)?.dem) return null;
    const { id, u, v } = found, i = Math.floor(u * meshSize), j = Math.floor(v * meshSize), a = u * meshSize - i, b = v * meshSize - j;
    const corner = (p: number, q: number): number => map.terrain!.getElevation(id, Math.min(EXTENT - 1e-3, (p * EXTENT) / meshSize), Math.min(EXTENT - 1e-3, (q * EXTENT) / meshSize));
    const low = corner(i, j), high = corner(i + 1, j + 1), side = b >= a ? corner(i, j + 1) : corner(i + 1, j);
    return b >= a ? low + b * (side - low) + a * (high - side) : low + a * (side - low) + b * (high - side);
  };
  return {
    begin,
    look: ({ x, y, z, yaw, pitch }) => map.jumpTo(map.calculateCameraOptionsFromCameraLngLatAltRotation(placeOf(x, z), y, -yaw / radians, 90 + pitch / radians, 0)),
    isLoading: () => !map.loaded() || !map.areTilesLoaded(),
    record: (places) => {
      const tiles = map.terrain ? map.terrain.sourceCache.getRenderableTiles() : [], heights = places.map(([x, z]) => heightAt(tiles, placeOf(x, z)));
      return () => heights;
    },
  };
}

/** MapLibre with heights alone, over the address of the examples' server. */
const mapPage = ({ detail, fov }: Plan): string => `<!doctype html><meta charset="utf-8"><style>html,body,#map{margin:0;width:100%;height:100%}</style><div id="map"></div>
<link rel="stylesheet" href="/node_modules/maplibre-gl/dist/maplibre-gl.css"><script src="/node_modules/maplibre-gl/dist/maplibre-gl.js"></script><script>
const ground = { type: 'raster-dem', encoding: 'terrarium', tileSize: ${detail}, maxzoom: 24, tiles: [location.origin + '/v1/sessions/default/heights/{z}/{x}/{y}.png?at=11.39,47.27'] };
const map = new maplibregl.Map({ container: 'map', center: [11.39, 47.27], zoom: 12, maxPitch: 89, maxZoom: 24, centerClampedToGround: false, fadeDuration: 0, attributionControl: false,
  pixelRatio: 0.1, // which tiles it takes does not depend on it, and software draws slowly
  style: { version: 8, sources: {}, layers: [{ id: 'plain', type: 'background', paint: { 'background-color': '#888' } }] } });
map.setVerticalFieldOfView(${(fov * 180) / Math.PI});
map.once('load', () => { globalThis.map = map; });
globalThis.begin = () => { // once it looks there
  map.addSource('ground', ground);
  map.setTerrain({ source: 'ground' });
};
</script>`;

async function fly(page: Page, plan: Plan): Promise<Omit<Shown, 'requests'>> {
  const first = plan.poses[0]!;
  return page.evaluate(
    async ({ poses, first, patience }) => {
      const { door } = globalThis as unknown as { door: Door }, sleep = (ms: number): Promise<void> => new Promise((done) => setTimeout(done, ms));
      const began = performance.now(), since = (): number => (performance.now() - began) / 1000;
      const record = ({ places }: Pose, t: number): { t: number; heights: () => Heights } => ({ t, heights: door.record(places!) });
      door.look(first);
      door.begin();
      const start: { t: number; heights: () => Heights }[] = [];
      for (let calm = 0; calm < 5 && since() < patience; await sleep(100)) {
        start.push(record(first, since()));
        calm = door.isLoading() ? 0 : calm + 1;
      }
      const departure = Date.now() / 1000, flown = performance.now(), flight: typeof start = [];
      for (const pose of poses) {
        const wait = flown + 1000 * pose.t - performance.now();
        if (wait > 0) await sleep(wait);
        else if (!pose.places) continue; // it is late already
        if (pose.places) flight.push(record(pose, pose.t));
        door.look(pose);
        door.isLoading();
      }
      const look = (all: typeof start): Shown['first'] => all.map(({ t, heights }) => ({ t, heights: heights() }));
      return { began: departure, first: look(start), flight: look(flight) };
    },
    { poses: plan.poses, first, patience: plan.patience },
  );
}

const plan = JSON.parse(readFileSync(needed('DOORS_PLAN'), 'utf8')) as Plan;
const site = await serveExamples(plan);
const browser = await launch();
try {
  const page = await (await browser.newContext({ viewport: { width: plan.width, height: plan.height } })).newPage();
  page.setDefaultTimeout(0);
  let requests = 0;
  page.on('request', (request) => void (request.url().includes('/v1/') && ++requests));
  page.on('pageerror', (error) => console.error(error.message));
  await page.addInitScript('globalThis.__name = (f) => f'); // which esbuild leaves in functions that are sent
  if (plan.viewer === 'three') {
    await page.goto(`${site.url}/three/?error=${plan.detail}&${plan.query}`, { waitUntil: 'commit' });
    await page.waitForFunction(() => 'ridgecast' in globalThis);
  } else {
    await page.route('**/doors/', (route) => route.fulfill({ contentType: 'text/html', body: mapPage(plan) }));
    await page.goto(`${site.url}/doors/`);
    await page.waitForFunction(() => 'map' in globalThis);
  }
  await page.evaluate(`globalThis.door = (${plan.viewer === 'three' ? threeDoor : maplibreDoor})()`);
  const shown = await fly(page, plan);
  writeFileSync(needed('DOORS_SHOWN'), JSON.stringify({ ...shown, requests } satisfies Shown));
} finally {
  site.child.kill();
  await closeAll();
}
