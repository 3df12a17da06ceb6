// How people reach a place: with fingers, by a link that somebody sent, and over TLS with a token.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync, writeSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import type { Report } from '../../../client/web/src/main';
import { Viewer, closeAll, launch, missing } from './browser';
import { Server, needed } from './server';

const why = missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

const SMALL = { width: 480, height: 270 };
const browser = await launch();
const server = await Server.start(['--terrain', 'alpine', '--seed', '1']);
test.afterEach(async () => {
  for (const context of browser.contexts()) await context.close();
});
test.after(async () => {
  await closeAll();
  await server.stop();
});

const apart = (a: Report, b: Report): number => Math.hypot(a.pose.x - b.pose.x, a.pose.z - b.pose.z) / 256;

test('fingers look, the stick and its buttons fly, a pinch goes forwards', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/#x=1400&z=3600&y=2830&yaw=-20&pitch=0&threshold=8`, SMALL, { hasTouch: true, isMobile: true });
  const start = await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  const device = await viewer.page.context().newCDPSession(viewer.page);
  const touch = (type: 'touchStart' | 'touchMove' | 'touchEnd', ...points: [number, number][]): Promise<unknown> =>
    device.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  const middle = async (selector: string): Promise<[number, number]> => {
    const box = (await viewer.page.locator(selector).boundingBox())!;
    return [box.x + box.width / 2, box.y + box.height / 2];
  };

  // A finger holds the ground: dragged to the right, one looks to the left.
  await touch('touchStart', [200, 120]);
  for (let k = 1; k <= 5; ++k) await touch('touchMove', [200 + 12 * k, 120]);
  await touch('touchEnd');
  await viewer.until('looking elsewhere', (r) => r.pose.yaw > start.pose.yaw + 0.05);
  const turned = await viewer.still();
  assert.ok(apart(turned, start) < 0.1, 'looking does not fly');

  const [sx, sy] = await middle('#stick');
  await touch('touchStart', [sx, sy]);
  await touch('touchMove', [sx, sy - 50]);
  const flown = await viewer.until('flying forwards', (r) => apart(r, turned) > 20);
  await touch('touchEnd');
  const heading = Math.atan2(-(flown.pose.x - turned.pose.x), -(flown.pose.z - turned.pose.z));
  assert.ok(Math.abs(heading - turned.pose.yaw) < 0.05, 'forwards is where it looks');
  const rests = await viewer.still(); // who lets go

  await touch('touchStart', await middle('[data-lift="1"]'));
  await viewer.until('rising', (r) => r.pose.y > rests.pose.y + 10);
  await touch('touchEnd');

  const before = await viewer.still();
  await touch('touchStart', [200, 100], [230, 100]);
  for (let k = 1; k <= 20; ++k) await touch('touchMove', [200 - 5 * k, 100], [230 + 5 * k, 100]);
  await touch('touchEnd');
  const pinched = await viewer.until('further on', (r) => apart(r, before) > 0.5);
  assert.equal(pinched.pose.yaw, before.pose.yaw);
  assert.deepEqual(viewer.complaints, []);
});

test('a link leads others to the same place, world and look, and never tells the token', async () => {
  const from = `${server.http}/#x=1000000000000.5&z=-77.25&y=700&yaw=33&pitch=-7&session=shared&terrain=canyon&seed=7&threshold=4&mode=split&token=secret`;
  const one = await Viewer.open(browser, from, SMALL, { permissions: ['clipboard-read', 'clipboard-write'] });
  const here = await one.until('connected', (r) => r.connected && r.figures !== undefined);
  assert.equal(here.world!.terrain, 'canyon');
  await one.page.keyboard.press('KeyL');
  await one.page.waitForFunction(() => !/token/.test(location.hash));
  const link = await one.page.evaluate(() => navigator.clipboard.readText());
  assert.ok(link.startsWith(`${server.http}/#`), link);
  assert.equal(link, await one.page.evaluate(() => location.href));
  assert.ok(!link.includes('secret'), link);

  const other = await Viewer.open(browser, link, SMALL);
  const there = await other.until('there, too', (r) => r.connected && r.others.length === 1 && r.figures !== undefined);
  const { x, z, y, yaw, pitch } = here.pose;
  assert.deepEqual([there.pose.x, there.pose.z, there.pose.y], [x, z, y]);
  assert.ok(Math.abs(there.pose.yaw - yaw) < 1e-4 && Math.abs(there.pose.pitch - pitch) < 1e-4);
  assert.deepEqual([there.world!.session, there.world!.terrain, there.world!.seed], ['shared', 'canyon', 7]);
  assert.equal(there.world!.threshold, 4);
  assert.equal(await other.page.getAttribute('[data-mode=split]', 'aria-pressed'), 'true');

  // Another link in the same window.
  await other.page.evaluate(() => void (location.hash = '#x=5&z=6&y=900&threshold=16&mode=mesh'));
  const moved = await other.until('elsewhere', (r) => r.connected && r.world?.session === 'default' && r.figures?.hashOk === true);
  assert.equal(moved.pose.x, 5 * 256);
  assert.equal(moved.world!.threshold, 16);
  // Nonsense in a link is not taken for a place.
  const odd = await Viewer.open(browser, `${server.http}/#x=nan&z=1e999&y=&yaw=%00&mode=%3Cscript%3E&threshold=-3&param=`, SMALL);
  const landed = await odd.until('somewhere', (r) => r.connected && r.figures?.hashOk === true);
  assert.ok([landed.pose.x, landed.pose.y, landed.pose.z].every(Number.isFinite));
  assert.deepEqual([...one.complaints, ...other.complaints, ...odd.complaints], []);
});

test('an address in the form of the other clients leads to the same world', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/?session=race&terrain=canyon&seed=7&clock=stepped&token=secret#threshold=1`, SMALL);
  const here = await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  assert.deepEqual([here.world!.session, here.world!.terrain, here.world!.seed, here.world!.threshold], ['race', 'canyon', 7, 1]);
  // From then on its address is a link to this place.
  await viewer.page.waitForFunction(() => location.search === '');
  const link = await viewer.page.evaluate(() => location.hash);
  for (const part of ['session=race', 'terrain=canyon', 'seed=7', 'clock=stepped', 'threshold=1']) assert.ok(link.includes(part), link);
  assert.ok(!link.includes('secret'), link);
});

test('a world whose text is private begins above its ground, too', async () => {
  const keeps = await Server.start(['--terrain', 'alpine', '--seed', '1', '--private-terrain']);
  try {
    const viewer = await Viewer.open(browser, `${keeps.http}/#x=1400&z=3600&threshold=8`, SMALL);
    const { pose, world } = await viewer.until('at rest', (r) => r.drawn && r.pose.y !== 3000);
    assert.match(world!.lacks, /to itself/);
    // The ground there is 2,637 m high; the mesh knows that to some metres from far above.
    assert.ok(Math.abs(pose.y - 150 - 2637) < 30, `${pose.y}`);
    assert.deepEqual(viewer.complaints, []);
  } finally {
    await keeps.stop();
  }
});

test('a world with parameters by a link', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/#x=0&z=0&y=900&session=wet&terrain=canyon&seed=1&param=riverLevel%3D550&threshold=8`, SMALL);
  await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  const { sessions } = (await (await fetch(`${server.http}/v1/sessions`)).json()) as { sessions: { name: string; parameters: object }[] };
  assert.deepEqual(sessions.find((s) => s.name === 'wet')!.parameters, { riverLevel: 550 });
  assert.deepEqual(viewer.complaints, []);
});

test('over TLS, with a token', async (t) => {
  const folder = mkdtempSync(join(tmpdir(), 'ridgecast-tls-'));
  const file = (name: string): string => join(folder, name);
  try {
    execFileSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:prime256v1', '-nodes', '-days', '2', '-subj', '/CN=127.0.0.1',
      '-addext', 'subjectAltName=IP:127.0.0.1', '-keyout', file('key.pem'), '-out', file('cert.pem')], { stdio: 'ignore' });
  } catch {
    rmSync(folder, { recursive: true });
    return t.skip('there is no openssl to make a certificate with');
  }
  writeFileSync(file('secret'), 'a secret that is long enough for HMAC with SHA-256\n', { mode: 0o600 });
  const token = (rights: string): string =>
    execFileSync(needed('RIDGECAST_SERVER'), ['token', '--jwt-secret-file', file('secret'), '--rights', rights, '--expires', '1h'], { encoding: 'utf8' }).trim();
  const guarded = await Server.start(['--tls-cert', file('cert.pem'), '--tls-key', file('key.pem'), '--jwt-secret-file', file('secret')]);
  try {
    const viewer = await Viewer.open(browser, `${guarded.https}/#x=1400&z=3600&y=2830&threshold=8`, SMALL, { ignoreHTTPSErrors: true });
    await viewer.page.waitForSelector('#token input', { state: 'visible' });
    await viewer.page.fill('#token input', 'nonsense');
    await viewer.page.click('#token button');
    await viewer.page.waitForFunction(() => /Give another/.test(document.getElementById('problem')!.innerText));
    await viewer.page.fill('#token input', token('view,snapshot'));
    await viewer.page.click('#token button');
    const inside = await viewer.until('connected', (r) => r.connected && r.atRest);
    assert.equal(inside.figures!.mismatches, 0);
    const [download] = await Promise.all([viewer.page.waitForEvent('download'), viewer.page.keyboard.press('KeyG')]);
    assert.equal(readFileSync((await download.path())!).subarray(0, 4).toString(), 'glTF');
    // The token stays in the tab: after a reload nobody is asked again.
    await viewer.page.reload();
    await viewer.until('connected again', (r) => r.connected && r.figures !== undefined);
    assert.ok(!(await viewer.page.evaluate(() => location.href)).includes('ey'), 'no token in the address');
    // With a good token that lacks a right the page says which.
    const looks = await Viewer.open(browser, `${guarded.https}/#x=1400&z=3600&y=2830&threshold=8&token=${token('view')}`, SMALL, { ignoreHTTPSErrors: true });
    await looks.until('connected', (r) => r.connected && r.figures !== undefined);
    await looks.page.keyboard.press('KeyG');
    await looks.said(/snapshot/);
  } finally {
    await guarded.stop();
    rmSync(folder, { recursive: true, force: true });
  }
});
