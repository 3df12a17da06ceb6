// The page's edit mode in Chromium against the real server: a click makes an edit where it was clicked, and says so; undo, refusals, and a
// token without the right.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { Viewer, closeAll, launch, missing } from './browser';
import { decodePng, ssim } from './picture';
import { Server, needed, sleep } from './server';

const why = missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

type Edit = { op: string; x: number; z: number; radius: number; line: [number, number][]; edit: number };

const SIZE = { width: 640, height: 360 }, PLACE = { x: 1400, z: 3600, y: 2830, yaw: -20, pitch: -22 };
const address = (session: string): string => `/#x=${PLACE.x}&z=${PLACE.z}&y=${PLACE.y}&yaw=${PLACE.yaw}&pitch=${PLACE.pitch}&threshold=1&session=${session}&terrain=alpine&seed=1`;
const browser = await launch();
const server = await Server.start(['--terrain', 'alpine', '--seed', '1']);
test.afterEach(async () => {
  for (const context of browser.contexts()) await context.close();
});
test.after(async () => {
  await closeAll();
  await server.stop();
});

async function editsOf(session: string): Promise<Edit[]> {
  const { edits } = (await (await fetch(`${server.http}/v1/sessions/${session}/edits`)).json()) as { edits: { edit: Edit }[] };
  return edits.map(({ edit }) => edit);
}
async function editsWhen(session: string, count: number): Promise<Edit[]> {
  for (let k = 0; k < 600; ++k, await sleep(100)) {
    const edits = await editsOf(session);
    if (edits.length >= count) return edits;
  }
  throw new Error(`there are not ${count} edits`);
}
/** Where the terrain itself lies below a pixel, by the server's ray; the rotation of the camera is written out once more. */
async function groundBelow(session: string, px: number, py: number): Promise<{ x: number; z: number; distance: number }> {
  const yaw = (PLACE.yaw * Math.PI) / 180, pitch = (PLACE.pitch * Math.PI) / 180, focal = SIZE.height / 2 / Math.tan(Math.PI / 6);
  const right = px - SIZE.width / 2, up = SIZE.height / 2 - py;
  const level = focal * Math.cos(pitch) - up * Math.sin(pitch), rise = focal * Math.sin(pitch) + up * Math.cos(pitch);
  const d = [right * Math.cos(yaw) - level * Math.sin(yaw), rise, -right * Math.sin(yaw) - level * Math.cos(yaw)], length = Math.hypot(...d);
  const [dx, dy, dz] = d.map((v) => v / length) as [number, number, number];
  const body = JSON.stringify({ rays: [[PLACE.x, PLACE.y, PLACE.z, dx, dy, dz]] });
  const answer = await fetch(`${server.http}/v1/rays?session=${session}`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body });
  assert.equal(answer.status, 200, await answer.clone().text());
  const { rays } = (await answer.json()) as { rays: { distance: number }[] };
  const { distance } = rays[0]!;
  return { x: PLACE.x + distance * dx, z: PLACE.z + distance * dz, distance };
}

test('a click makes a crater below the pointer, undo takes it back, and the mesh agrees', async (t) => {
  const viewer = await Viewer.open(browser, server.http + address('clicks'), SIZE), { page } = viewer, [px, py] = [350, 300];
  await viewer.until('settled', (r) => r.atRest);
  const expected = await groundBelow('clicks', px, py);
  await page.mouse.click(px, py);
  assert.deepEqual(await editsOf('clicks'), [], 'without the edit mode a click does nothing');
  await page.keyboard.press('KeyI');
  await page.mouse.move(px, py);
  await page.waitForFunction(() => document.querySelector('#brush path')!.getAttribute('d') !== '');
  for (let k = 0; k < 10; ++k) await page.mouse.wheel(0, -100);
  await page.waitForFunction(() => /radius 32 m/.test(document.getElementById('brush-words')!.textContent!));
  assert.equal((await viewer.still()).pose.x, PLACE.x * 256, 'the wheel and the click did not fly');
  // The outline lies around the pointer.
  const { box, speed } = await page.evaluate(() => {
    const { x, y, width, height } = document.querySelector<SVGGraphicsElement>('#brush path')!.getBBox();
    return { box: { x, y, width, height }, speed: document.getElementById('speed')!.textContent };
  });
  assert.ok(box.x < px && px < box.x + box.width && box.y < py && py < box.y + box.height, JSON.stringify(box));
  assert.equal(speed, '50 m/s');

  await page.mouse.click(px, py);
  await viewer.said(/^Edit 1 made\.$/);
  const [crater] = await editsOf('clicks') as [Edit];
  assert.equal(crater.op, 'crater');
  assert.ok(Math.abs(crater.radius - 32.4) < 0.3);
  const off = Math.hypot(crater.x - expected.x, crater.z - expected.z);
  t.diagnostic(`${off.toFixed(3)} m from the terrain's own, ${expected.distance.toFixed(0)} m away`);
  assert.ok(off < expected.distance / 300, `${off} m off`); // a pixel
  const edited = await viewer.until('edited', (r) => r.atRest && r.figures!.edit === 1);
  assert.equal(edited.figures!.mismatches, 0);

  await page.keyboard.press('KeyU');
  await viewer.said(/^Edit 1 undone\.$/);
  assert.deepEqual((await editsOf('clicks')).slice(1), [{ op: 'undo', edit: 1 }]);
  await viewer.until('as it was', (r) => r.atRest && r.figures!.mismatches === 0 && r.figures!.iteration > edited.figures!.iteration);
  await page.keyboard.press('KeyU');
  await viewer.said(/no edit to undo/);

  // Keys alone: the brush in the middle of the picture.
  await page.mouse.move(-1, -1);
  await page.focus('#here');
  const middle = await groundBelow('clicks', SIZE.width / 2, SIZE.height / 2);
  await page.keyboard.press('Enter');
  const last = (await editsWhen('clicks', 3))[2]!, reach = Math.hypot(last.x - middle.x, last.z - middle.z);
  t.diagnostic(`in the middle ${reach.toFixed(3)} m, ${middle.distance.toFixed(0)} m away`);
  assert.ok(reach < middle.distance / 300, `${reach} m off`);
  // One that somebody else has undone is not one's last.
  await fetch(`${server.http}/v1/sessions/clicks/edits/3`, { method: 'DELETE' });
  await page.click('#undo');
  await viewer.said(/no edit to undo/);
  assert.equal((await editsOf('clicks')).length, 4);
  assert.equal((await viewer.report()).figures!.mismatches, 0);
  assert.deepEqual(viewer.complaints, []);
});

test('a road follows clicks until a double click; a refusal is said in the server\'s words; drags look around', async () => {
  const viewer = await Viewer.open(browser, server.http + address('roads'), SIZE), { page } = viewer;
  const start = await viewer.until('settled', (r) => r.atRest);
  await page.click('#more');
  await page.click('#editing');
  await page.click('[data-tool=road]');
  await page.mouse.click(300, 310);
  await page.mouse.click(340, 305);
  await page.mouse.dblclick(370, 320);
  await viewer.said(/^Edit 1 made\.$/);
  assert.equal((await editsOf('roads'))[0]!.op, 'road');
  assert.equal(await page.evaluate(() => document.pointerLockElement), null);
  // Over all the mountains to the valley behind them.
  await page.mouse.click(350, 320);
  await page.mouse.click(240, 140);
  await page.keyboard.press('Enter');
  await viewer.said(/2048 m/);
  assert.equal((await editsOf('roads')).length, 1);
  await page.mouse.move(300, 300);
  await page.mouse.down();
  await page.mouse.move(200, 300, { steps: 4 });
  await page.mouse.up();
  await viewer.until('looking elsewhere', (r) => Math.abs(r.pose.yaw - start.pose.yaw) > 0.1);
  await page.keyboard.press('KeyI');
  assert.ok(await page.isHidden('#edit'));
  assert.equal((await editsOf('roads')).length, 1);
  assert.deepEqual(viewer.complaints, []);
});

test('fingers: a tap on the ground', async () => {
  const viewer = await Viewer.open(browser, server.http + address('taps'), SIZE, { hasTouch: true, isMobile: true }), { page } = viewer;
  await viewer.until('settled', (r) => r.atRest);
  const more = page.locator('#more');
  if (await more.isVisible()) await more.tap();
  await page.tap('#editing');
  await page.tap('[data-tool=raise]');
  const expected = await groundBelow('taps', 350, 280);
  await page.touchscreen.tap(350, 280);
  const [edit] = await editsWhen('taps', 1) as [Edit];
  assert.equal(edit.op, 'raise');
  const off = Math.hypot(edit.x - expected.x, edit.z - expected.z);
  assert.ok(off < expected.distance / 300, `${off} m off`);
  await page.tap('#undo');
  await viewer.said(/^Edit 1 undone\.$/);
});

test('ray march and corrected mesh show edited ground, as the desktop client does, from the edit on', async (t) => {
  const small = { width: 160, height: 90 }, at = `&session=shown&terrain=alpine&seed=1`;
  const viewer = await Viewer.open(browser, `${server.http}/#x=1400&z=3640&y=2690&yaw=-5&pitch=-25&threshold=1&mode=march${at}`, small);
  const shown = async (what: string, edit: number): Promise<ReturnType<typeof decodePng>> => {
    await viewer.until(what, (r) => r.drawn && r.figures!.edit === edit);
    const png = await viewer.picture();
    return decodePng(png);
  };
  const before = await shown('unedited', 0);
  const made = await fetch(`${server.http}/v1/sessions/shown/edits`, {
    method: 'POST',
    headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ op: 'raise', x: 1408, z: 3540, radius: 40, core: 20, by: 30, material: 'asphalt' }),
  });
  assert.equal(made.status, 201);
  const march = await shown('edited', 1);
  const folder = mkdtempSync(join(tmpdir(), 'ridgecast-shown-')), file = join(folder, 'march.png');
  const height = ((await (await fetch(`${server.http}/v1/heights?at=1400,3640&session=shown`)).json()) as { heights: number[] }).heights[0]!;
  const pose = ['--x', '1400', '--z', '3640', '--altitude', String(2690 - height), '--yaw', '-5', '--pitch', '-25', '--size', '160x90', '--supersample', '1'];
  execFileSync(needed('RIDGECAST_CLIENT'), ['picture', `${server.http.replace('http', 'ws')}?session=shown`, ...pose, '--draw', 'march', '--out', file], { stdio: 'ignore' });
  const alike = ssim(march, decodePng(readFileSync(file)));
  rmSync(folder, { recursive: true, force: true });
  const changed = ssim(march, before);
  await viewer.page.keyboard.press('Digit1');
  const mesh = await shown('corrected', 1), corrected = ssim(march, mesh);
  t.diagnostic(`SSIM of the page's ray march with the desktop client's ${alike.toFixed(4)}, with the one before the edit ${changed.toFixed(4)}, with the corrected mesh ${corrected.toFixed(4)}`);
  assert.ok(alike > 0.97 && changed < 0.92 && corrected > 0.92);
  // Undone, it is the picture of before.
  await fetch(`${server.http}/v1/sessions/shown/edits/1`, { method: 'DELETE' });
  await viewer.page.keyboard.press('Digit2');
  assert.ok(ssim(await shown('undone', 2), before) > 0.9999);
  assert.deepEqual(viewer.complaints, []);
});

test('who lacks the right is told, and connected still', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'ridgecast-right-'));
  try {
    const tokens = join(folder, 'tokens'), token = (rights: string): string => {
      execFileSync(needed('RIDGECAST_SERVER'), ['token', '--token-file', tokens, '--holder', rights.replace(',', '-'), '--rights', rights, '--out', join(folder, rights)], { stdio: 'ignore' });
      return readFileSync(join(folder, rights), 'utf8').trim();
    };
    const viewing = token('view'), editing = token('view,edit');
    const guarded = await Server.start(['--terrain', 'alpine', '--seed', '1', '--token-file', tokens]);
    try {
      const open = async (own: string): Promise<Viewer> => {
        const viewer = await Viewer.open(browser, `${guarded.http}/#x=1400&z=3600&y=2830&threshold=16&token=${own}`, SIZE);
        await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
        await viewer.page.keyboard.press('KeyI');
        return viewer;
      };
      const one = await open(viewing);
      await one.said(/lacks the right 'edit'/);
      assert.ok(await one.page.isHidden('#edit'));
      assert.ok((await one.report()).connected);
      const two = await open(editing);
      await two.page.waitForSelector('#edit:not([hidden])');
    } finally {
      await guarded.stop();
    }
  } finally {
    rmSync(folder, { recursive: true, force: true });
  }
});
