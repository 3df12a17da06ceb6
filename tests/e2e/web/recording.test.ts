// A recording in the page: a flight by the page itself, on a server that is killed, is played to onlookers who pause it, change its speed and
// go anywhere in it.

import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import type { Report } from '../../../client/web/src/main';
import { Viewer, closeAll, launch, missing } from './browser';
import { Server, sleep } from './server';

const why = missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

const PLACE = '#x=1400&z=3600&y=2830&yaw=-20&pitch=-12&threshold=16';
const folder = mkdtempSync(join(tmpdir(), 'ridgecast-recording-'));
const browser = await launch();
const servers: Server[] = [];
test.after(async () => {
  await closeAll();
  for (const server of servers) await server.stop('SIGKILL');
  rmSync(folder, { recursive: true, force: true });
});

test('onlookers of a recorded flight drive its clock', async () => {
  const recorded = await Server.start(['--record', folder]);
  servers.push(recorded);
  const flier = await Viewer.open(browser, `${recorded.http}/${PLACE}&name=Ada`);
  const start = await flier.until('connected', (r) => r.connected && r.figures !== undefined);
  for (let k = 0; k < 3; ++k) await flier.page.keyboard.press('Quote');
  await flier.until('eleven seconds on', (r) => r.clock > 11e6); // it ends with what happens last, and goes back by ten seconds
  for (let k = 0; k < 3; ++k) await flier.page.keyboard.press('Semicolon');
  await flier.page.keyboard.down('KeyW');
  const far = await flier.until('200 m on', (r) => Math.hypot(r.pose.x - start.pose.x, r.pose.z - start.pose.z) > 200 * 256);
  await flier.page.keyboard.up('KeyW');
  const crater = { op: 'crater', x: 1500, z: 3300, radius: 40, depth: 15 };
  assert.equal((await fetch(`${recorded.http}/v1/sessions/default/edits`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(crater) })).status, 201);
  await flier.until('told of the edit', (r) => r.figures?.edit === 1);
  await sleep(3000); // two blocks
  await recorded.stop('SIGKILL');
  await flier.close();

  const player = await Server.start([], 0, ['replay', folder, '--serve']);
  servers.push(player);
  const onlooker = await Viewer.open(browser, `${player.http}/${PLACE}`);
  const { page } = onlooker;
  const text = (id: string): Promise<string | null> => page.textContent(`#${id}`);
  const shows = (id: string, what: RegExp): Promise<unknown> =>
    page.waitForFunction(([id, source]) => new RegExp(source!).test(document.getElementById(id!)!.textContent!), [id, what.source]);
  const stands = async (): Promise<Report> => {
    await shows('clock-pause', /^(Resume|Again)$/);
    for (let tries = 0; ; ++tries) {  // on a busy machine the next frame, with the clock as it was stopped, comes later
      const before = await onlooker.report();
      await sleep(300);
      const after = await onlooker.report();
      if (after.clock === before.clock) return after;
      assert.ok(tries < 20, 'the clock stands');
    }
  };
  const back = async (at: (report: Report) => boolean, act: () => Promise<void>): Promise<Report> => {
    const { world } = await onlooker.report();
    await act();
    return onlooker.until('in the session that begins again', (r) => r.connected && r.world!.camera !== world!.camera && at(r) && r.figures?.hashOk === true);
  };

  await onlooker.until('connected', (r) => r.connected && r.frames !== undefined);
  await shows('clock-time', /^0:\d\d\.\d \/ \d:\d\d\.\d$/);
  // Slowly, from its beginning: loading the page has taken its time.
  await page.keyboard.press('Semicolon');
  await page.keyboard.press('Semicolon');
  await shows('clock-rate', /^0.25 x$/);
  await back(() => true, () => page.fill('#clock-slider', '0'));
  await onlooker.until('seeing Ada', (r) => r.others.some((o) => o.name === 'Ada' && o.at !== undefined));
  await page.keyboard.press('KeyZ');
  await stands();

  const length = await page.evaluate(() => Number(document.querySelector<HTMLInputElement>('#clock-slider')!.max));
  for (let k = 0; k < length / 10 + 1; ++k) await page.keyboard.press('Digit0');
  await onlooker.until('at the end', (r) => r.clock === Math.round(length * 1e6) && r.others.length === 0 && r.figures?.edit === 1);
  await shows('clock-pause', /^Again$/);

  // Back: the ground is that of then, and it stands as before.
  await back((r) => r.clock <= length * 1e6 - 9e6 && r.clock > 1e5, () => page.keyboard.press('Digit9'));
  await stands();
  const first = await back((r) => r.clock === 1e5 && r.figures?.edit === 0, () => page.fill('#clock-slider', '0.1'));
  await stands();
  assert.equal(first.others.length, 0);
  // Ahead, while it stands: a page of two pictures a second would miss her as she flies by.
  const there = Math.floor(far.clock / 1e5) / 10;
  await page.fill('#clock-slider', `${there}`);
  await onlooker.until('seeing Ada far on', (r) => r.others.some((o) => o.at !== undefined && Math.hypot(o.at.x - start.pose.x, o.at.z - start.pose.z) > 100 * 256));
  for (let k = 0; k < 4; ++k) await page.keyboard.press('Quote');
  await shows('clock-rate', /^4 x$/);
  await page.keyboard.press('KeyZ');
  await onlooker.until('going on', (r) => r.clock > there * 1e6);
  await page.click('#slower');
  await shows('clock-rate', /^2 x$/);
  await page.click('#clock-ahead');
  await page.click('#clock-ahead');
  await shows('clock-time', /./);
  assert.equal(await text('clock-driver'), '', 'it is everybody\'s again');
  assert.deepEqual(onlooker.complaints, []);
});
