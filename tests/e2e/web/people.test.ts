// What people need of the page at a desk and on a telephone: axe-core finds nothing, keys reach everything, fingers alone suffice, and the
// members of a session know of each other.

import assert from 'node:assert/strict';
import { readFileSync, writeSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { test } from 'node:test';
import { fromBinary, toBinary, create } from '@bufbuild/protobuf';
import { ClientMessageSchema, ServerMessageSchema } from '../../../client/web/src/generated/ridgecast/v1/stream_pb';
import { Viewer, closeAll, launch, missing } from './browser';
import { NodeSocket } from './node_socket';
import { Server, needed } from './server';

const why = missing();
if (why) {
  writeSync(1, `SKIPPED: ${why}\n`);
  process.exit(0);
}

interface AxeResults {
  violations: { id: string; nodes: { html: string }[] }[];
}

const DESK = { width: 1280, height: 720 }, PHONE = { width: 390, height: 844 }, LANDSCAPE = { width: 844, height: 390 };
const FINGERS = { hasTouch: true, isMobile: true };
const PLACE = '#x=1400&z=3600&y=2830&yaw=-20&pitch=-12&threshold=16';
const AXE = readFileSync(createRequire(needed('RIDGECAST_WEB') + '/').resolve('axe-core/axe.min.js'), 'utf8');
const browser = await launch();
// Nobody looks at the pictures, and without a graphics card a built-in terrain's shaders take long to compile.
const server = await Server.start(['--terrain', join(needed('RIDGECAST_SOURCE'), 'tests/e2e/web/hills.glsl')]);
test.afterEach(async () => {
  for (const context of browser.contexts()) await context.close();
});
test.after(async () => {
  await closeAll();
  await server.stop();
});

async function hasNoFaults(viewer: Viewer, where: string): Promise<void> {
  await viewer.page.evaluate(AXE);
  const { violations } = await viewer.page.evaluate(() => (globalThis as unknown as { axe: { run: () => Promise<AxeResults> } }).axe.run());
  assert.deepEqual(violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html).join(' ')}`), [], where);
}

/** What is at the window's edge or beyond, or too small for a finger. */
async function misfits(viewer: Viewer, least: number): Promise<string[]> {
  return viewer.page.evaluate((least) => {
    const shown = [...document.querySelectorAll<HTMLElement>('button, select, input, summary, #figures, #legend, #note, dialog[open]')].filter((e) => e.checkVisibility());
    return shown
      .filter((e) => {
        const box = e.getBoundingClientRect(), isText = !e.matches('button, select, input, summary');
        return box.left < 0 || box.right > innerWidth + 0.5 || box.top < 0 || (!isText && (box.height < least || (e.matches('button') && box.width < least)));
      })
      .map((e) => `${e.outerHTML.slice(0, 60)} ${JSON.stringify(e.getBoundingClientRect())}`);
  }, least);
}

for (const [size, name, more, least] of [
  [DESK, 'a desk', {}, 24],
  [PHONE, 'a telephone', FINGERS, 40],
  [LANDSCAPE, 'a telephone on its side', FINGERS, 40],
] as const)
  test(`axe-core finds nothing on ${name}, and everything has its room`, async () => {
    const viewer = await Viewer.open(browser, `${server.http}/${PLACE}&mode=split`, size, more);
    await viewer.until('connected', (r) => r.connected && r.frames !== undefined);
    const press = async (selector: string): Promise<void> => viewer.page.locator(selector).click();
    if (size !== DESK) await press('#more');
    for (const toggle of ['nodes', 'candidates', 'figures']) await press(`[data-toggle=${toggle}]`);
    await press('#timing');
    await hasNoFaults(viewer, 'the page');
    assert.deepEqual(await misfits(viewer, least), []);
    for (const [opener, dialog] of [['#help', '#help-text'], ['#people', '#who'], ['#place', '#worlds']] as const) {
      await press(opener);
      await viewer.page.waitForSelector(`${dialog}[open]`);
      if (dialog === '#worlds') await viewer.page.waitForFunction(() => document.querySelectorAll('#sessions button').length > 0 && document.querySelectorAll('#make option').length >= 3);
      if (dialog === '#worlds') await press('#worlds summary');
      assert.equal(await viewer.page.locator(dialog).evaluate((e) => e.scrollTop), 0, `${dialog} opens at its beginning`);
      await hasNoFaults(viewer, dialog);
      assert.deepEqual(await misfits(viewer, least), [], dialog);
      await press(`${dialog} form[method=dialog] button`);
    }
    await viewer.page.emulateMedia({ forcedColors: 'active' });
    const background = (selector: string): Promise<string> => viewer.page.locator(selector).evaluate((e) => getComputedStyle(e).backgroundColor);
    assert.notEqual(await background('[data-mode=split]'), await background('[data-mode=mesh]'), 'what is pressed shows with forced colours');
    assert.deepEqual(viewer.complaints, []);
  });

// M, M, Esc made somebody "m".
test('lists open and close by their keys, and a name is changed by nobody who does not want to', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/${PLACE}`, DESK);
  const { page } = viewer;
  const start = await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  const open = (): Promise<string[]> => page.evaluate(() => [...document.querySelectorAll('dialog[open]')].map((e) => e.id));
  const name = page.locator('#own-name input');
  await name.evaluate((e: HTMLInputElement) => (e.value = ''));
  await page.focus('#view');
  for (const [keys, shown] of [
    ['m', 'who'], ['m', ''], ['m', 'who'], ['Escape', ''], ['m', 'who'], ['h', 'help-text'], ['h', ''], ['j', 'worlds'], ['j', ''],
  ] as const) {
    await page.keyboard.press(keys);
    assert.equal((await open()).join(), shown, keys);
  }
  assert.equal(await name.inputValue(), '');
  await page.keyboard.press('m');
  await page.keyboard.down('w');
  await viewer.until('flying on', (r) => Math.abs(r.pose.z - start.pose.z) > 5);
  await page.keyboard.up('w');
  await name.fill('Ada');
  await page.keyboard.press('Escape');
  assert.deepEqual(await open(), []);
  assert.equal(await page.evaluate(() => localStorage.getItem('name')), null);
  await page.keyboard.press('m');
  assert.equal(await name.inputValue(), '');
  await name.fill('Ada');
  await page.keyboard.press('Enter');
  assert.equal(await page.evaluate(() => localStorage.getItem('name')), 'Ada');
});

test('the error and the correction that somebody chose last are there again', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/#x=1400&z=3600&y=2830&yaw=-20&pitch=-12`, DESK);
  await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  await viewer.page.selectOption('#threshold', '16');
  await viewer.page.keyboard.press('t');
  await viewer.page.goto(`${server.http}/?again#x=1400&z=3600&y=2830`);
  await viewer.until('connected again', (r) => r.connected && r.figures !== undefined);
  assert.equal(await viewer.page.inputValue('#threshold'), '16');
  assert.equal(await viewer.page.getAttribute('[data-toggle=corrected]', 'aria-pressed'), 'false');
});

test('a server that is silent is told within 5 s, and when it speaks again', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/${PLACE}`, DESK);
  await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  const light = (state: string): Promise<unknown> => viewer.page.waitForSelector(`#light[data-state=${state}]`, { state: 'attached' });
  await light('on');
  const world = await viewer.page.textContent('#world');
  server.signal('SIGSTOP');
  try {
    await light('wait');
    assert.equal(await viewer.page.textContent('#world'), 'the server is silent');
  } finally {
    server.signal('SIGCONT');
  }
  await light('on');
  assert.equal(await viewer.page.textContent('#world'), world);
});

test('keys press buttons, change speed and divider, and keep their focus', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/${PLACE}&mode=split`, DESK);
  const { page } = viewer;
  const start = await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  await page.focus('[data-toggle=wireframe]');
  await page.keyboard.press('Space', { delay: 300 });
  assert.equal(await page.getAttribute('[data-toggle=wireframe]', 'aria-pressed'), 'true');
  assert.equal((await viewer.still()).pose.y, start.pose.y, 'Space on a button does not fly');

  await page.focus('#view');
  await page.keyboard.press('+');
  await viewer.said(/Speed 72 m\/s/);
  const divider = (): Promise<number> => page.getAttribute('#divider', 'aria-valuenow').then(Number);
  await page.keyboard.press('.');
  assert.equal(await divider(), 52);
  await page.focus('#divider');
  await page.keyboard.press('ArrowLeft');
  await page.keyboard.press('ArrowLeft');
  assert.equal(await divider(), 48);
  assert.equal((await viewer.still()).pose.yaw, start.pose.yaw, 'the arrows moved the divider and looked nowhere');

  // Another error without another connection: the same camera, and the focus stays.
  await page.focus('#threshold');
  await page.selectOption('#threshold', '8');
  const granted = await viewer.until('granted', (r) => r.world!.threshold === 8 && r.figures!.effectiveThreshold === 8);
  assert.equal(granted.world!.camera, start.world!.camera);
  assert.equal(await page.evaluate(() => document.activeElement!.id), 'threshold');

  // Keys act again once a dialog is closed, and a key that opens something is not typed into it.
  await page.evaluate(() => (document.activeElement as HTMLElement).blur());
  await page.keyboard.press('KeyH');
  await page.waitForSelector('#help-text[open]');
  await page.keyboard.press('Escape');
  await page.keyboard.press('KeyJ');
  await page.waitForSelector('#worlds[open]');
  await page.fill('#jump input', 'nowhere');
  await page.press('#jump input', 'Enter');
  assert.ok(await page.isVisible('#worlds'), 'that is no place');
  await page.fill('#jump input', '1e12 -250');
  await page.press('#jump input', 'Enter');
  await viewer.until('far away', (r) => r.pose.x === 256e12 && r.pose.z === -250 * 256 && r.figures?.hashOk === true);
  await page.keyboard.press('KeyM');
  await page.waitForSelector('#who[open]');
  assert.equal(await page.inputValue('#own-name input'), '');
  assert.deepEqual(viewer.complaints, []);
});

test('fingers alone: fly, change the speed, see who is here, take a link and come back by it', async () => {
  const other = await Viewer.open(browser, `${server.http}/#x=1502&z=3320&y=2770&yaw=160&pitch=0&threshold=16&name=Grace`, { width: 320, height: 180 });
  await other.until('connected', (r) => r.connected);
  const phone = await Viewer.open(browser, `${server.http}/${PLACE}`, PHONE, { ...FINGERS, permissions: ['clipboard-read', 'clipboard-write'] });
  const { page } = phone;
  const start = await phone.until('with somebody', (r) => r.connected && r.frames !== undefined && r.others.some((o) => o.at));
  const device = await page.context().newCDPSession(page);
  const touch = (type: 'touchStart' | 'touchMove' | 'touchEnd', ...points: [number, number][]): Promise<unknown> =>
    device.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });

  // 1: fly.
  const stick = (await page.locator('#stick').boundingBox())!, [x, y] = [stick.x + stick.width / 2, stick.y + stick.height / 2];
  await touch('touchStart', [x, y]);
  await touch('touchMove', [x, y - 50]);
  await phone.until('flying', (r) => Math.hypot(r.pose.x - start.pose.x, r.pose.z - start.pose.z) > 10 * 256);
  await touch('touchEnd');
  // 2: change the speed.
  await page.tap('[data-faster="1"]');
  await page.waitForFunction(() => document.getElementById('speed')!.textContent === '104 m/s');
  // 3: see who is here, and go there.
  assert.equal(await page.innerText('#people'), '2 here');
  await page.tap('#people');
  await page.tap('#others button:has-text("Grace")');
  const beside = await phone.still();
  const grace = beside.others[0]!.at!;
  assert.ok(Math.abs(Math.hypot(beside.pose.x - grace.x, beside.pose.z - grace.z) / 256 - 60) < 0.1);
  await page.waitForSelector('.member:not([hidden]):has-text("Grace")');
  // 4: take a link.
  await page.tap('#more');
  await page.tap('#link');
  const link = await page.evaluate(() => navigator.clipboard.readText());
  // 5: come back by it.
  await page.goto('about:blank');
  await page.goto(link);
  const back = await phone.until('back', (r) => r.connected && r.others.length === 1);
  assert.ok(Math.abs(back.pose.x - beside.pose.x) <= 1 && Math.abs(back.pose.z - beside.pose.z) <= 1 && Math.abs(back.pose.y - beside.pose.y) < 0.01);
  assert.deepEqual(phone.complaints, []);
});

test('on a telephone a finger looks beside the handle of the divider, and moves it there', async () => {
  const phone = await Viewer.open(browser, `${server.http}/${PLACE}&mode=split`, PHONE, FINGERS);
  const start = await phone.until('connected', (r) => r.connected && r.figures !== undefined);
  const device = await phone.page.context().newCDPSession(phone.page);
  const drag = async (x: number, y: number): Promise<void> => {
    await device.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: [{ x, y }] });
    for (let k = 1; k <= 5; ++k) await device.send('Input.dispatchTouchEvent', { type: 'touchMove', touchPoints: [{ x: x + 10 * k, y }] });
    await device.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  };
  await drag(PHONE.width / 2, 600);
  const turned = await phone.until('looking elsewhere', (r) => r.pose.yaw > start.pose.yaw + 0.05);
  assert.equal(await phone.page.getAttribute('#divider', 'aria-valuenow'), '50');
  await drag(PHONE.width / 2, PHONE.height / 2);
  assert.equal(await phone.page.getAttribute('#divider', 'aria-valuenow'), '63');
  assert.equal((await phone.still()).pose.yaw, turned.pose.yaw);
});

test('names are remembered, and links do not tell them', async () => {
  const one = await Viewer.open(browser, `${server.http}/${PLACE}&name=Ada`, { width: 480, height: 270 });
  await one.until('connected', (r) => r.connected && r.figures !== undefined);
  const two = await Viewer.open(browser, `${server.http}/${PLACE}`, { width: 480, height: 270 });
  await two.until('seeing Ada', (r) => r.others.some((o) => o.name === 'Ada'));
  await one.page.waitForFunction(() => !location.hash.includes('Ada'));
  await one.page.reload();
  await two.until('seeing Ada again', (r) => r.others.length === 1 && r.others[0]!.name === 'Ada' && r.others[0]!.at !== undefined);
  await one.page.keyboard.press('KeyM');
  await one.page.fill('#own-name input', 'Ada Lovelace');
  await one.page.press('#own-name input', 'Enter');
  await two.until('seeing her whole name', (r) => r.others.length === 1 && r.others[0]!.name === 'Ada Lovelace');
});

test('a world of the terrains that the server offers, with their parameters', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/${PLACE}`, DESK);
  const { page } = viewer;
  await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  await page.keyboard.press('KeyJ');
  await page.waitForFunction(() => document.querySelectorAll('#make option').length >= 3);
  await page.click('#worlds summary');
  await page.fill('#make [name=session]', 'snowy');
  await page.selectOption('#make select', 'alpine');
  await page.fill('#make [name="param snowLine"]', '900');
  await page.click('#make button');
  await viewer.until('there', (r) => r.connected && r.world?.session === 'snowy' && r.figures?.hashOk === true);
  const { sessions } = (await (await fetch(`${server.http}/v1/sessions`)).json()) as { sessions: { name: string; parameters: object }[] };
  assert.deepEqual(sessions.find((s) => s.name === 'snowy')!.parameters, { snowLine: 900 });
});

test('steps do not wait for a page, and one that is passed over is told', async () => {
  const viewer = await Viewer.open(browser, `${server.http}/${PLACE}&session=stepped&terrain=canyon`, { width: 320, height: 180 });
  const { world } = await viewer.until('connected', (r) => r.connected && r.figures !== undefined);
  const socket = new NodeSocket(`${server.ws}/v1/stream?session=stepped`);
  let done = 0n;
  const send = (kind: NonNullable<Parameters<typeof create<typeof ClientMessageSchema>>[1]>['kind']): void => socket.send(toBinary(ClientMessageSchema, create(ClientMessageSchema, { kind })));
  const step = (): void => send({ case: 'step', value: { $typeName: 'ridgecast.v1.Step', time: 1000n, wait: true } });
  await new Promise<void>((resolve, reject) => {
    socket.onopen = () => {
      send({ case: 'hello', value: { $typeName: 'ridgecast.v1.Hello', protocolVersion: 1, clientName: new Uint8Array(), pacing: 0, points: true, role: 1, members: false, clock: true, errors: false, edits: false, editsAfter: 0n, near: 0, states: false, placesOnly: false } });
    };
    socket.onclose = ({ reason }) => reject(new Error(reason));
    socket.onmessage = ({ data }) => {
      const { kind } = fromBinary(ServerMessageSchema, new Uint8Array(data as ArrayBuffer));
      if (kind.case === 'world') {
        send({ case: 'setClock', value: { $typeName: 'ridgecast.v1.SetClock', own: true, mode: 2, rate: 0, time: 0n } });
        step();
      }
      if (kind.case !== 'clock') return;
      if (/passed over at step/.test(new TextDecoder().decode(kind.value.notice))) return resolve();
      if (kind.value.step === done || kind.value.waitsFor.length > 0) return;
      done = kind.value.step;
      step();
      // From the fourth on passed over at once: some time before the page has said that it is done.
      if (done >= 3n) send({ case: 'passOver', value: { $typeName: 'ridgecast.v1.PassOver', camera: BigInt(world!.camera) } });
    };
  });
  await viewer.said(/passed over at step/);
  assert.ok(done >= 3n);
  // Its clock is somebody else's.
  await viewer.page.keyboard.press('KeyV');
  await viewer.page.waitForFunction(() => /^Guest \d+ owns it$/.test(document.getElementById('clock-driver')!.textContent!));
  assert.ok(await viewer.page.isDisabled('#clock-pause'));
  await viewer.page.keyboard.press('KeyZ');
  await viewer.said(/^Guest \d+ owns the clock\.$/);
  socket.onclose = null;
  socket.close();
  assert.deepEqual(viewer.complaints, []);
});
