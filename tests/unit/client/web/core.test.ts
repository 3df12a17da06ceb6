// The core in WebAssembly, without a socket: the recorded stream of proto/example, hashes as PROTOCOL.md gives them, a person's hands,
// frames that are none, and the end of memory. What the core is, its C++ tests judge.

import { type MessageInitShape, create, fromBinary, toBinary } from '@bufbuild/protobuf';
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { Core } from '../../../../client/web/src/core/core';
import { ClientMessageSchema, ClockSchema, Error_Code, ServerMessageSchema } from '../../../../client/web/src/generated/ridgecast/v1/stream_pb';
import { type Act, type Camera, type FromEngine, TOOLS, type ToPainterFromEngine, type Touched } from '../../../../client/web/src/messages';
import type { Pose } from '../../../../client/web/src/render/view';
import { pathOf, towards } from '../../../../client/web/src/ui/outline';
import { Copy, hashLeaf, hashTerm, hashVertex, mix, parts } from '../../../support/web';

const file = (name: string): Buffer => readFileSync(join(process.env['RIDGECAST_SOURCE']!, 'proto', name));
const loaded = await parts();
const bytes = (text: string): Uint8Array<ArrayBuffer> => new TextEncoder().encode(text);
const textOf = (bytes: Uint8Array): string => new TextDecoder().decode(bytes);

function frames(): Uint8Array[] {
  const stream = file('example/stream.bin'), out: Uint8Array[] = [];
  for (let at = 0; at < stream.length; at += 4 + stream.readUInt32LE(at)) out.push(Uint8Array.from(stream.subarray(at + 4, at + 4 + stream.readUInt32LE(at))));
  return out;
}

/** The recording's world, of a server of today. */
function worldOfToday(): Uint8Array {
  const world = fromBinary(ServerMessageSchema, frames()[0]!);
  if (world.kind.case === 'world') world.kind.value.revision = 6;
  return toBinary(ServerMessageSchema, world);
}

/** A core whose line has been opened, and what it says. */
class Held {
  readonly copy = new Copy();
  readonly told: FromEngine[] = [];
  readonly painted: ToPainterFromEngine[] = [];
  readonly sent: Uint8Array[] = [];
  readonly dialled: [string, boolean][] = []; // where, and whether with the token
  wrong = '';
  readonly core = new Core(loaded.core, loaded.draco, {
    dial: (elsewhere, showsToken) => this.dialled.push([elsewhere, showsToken]),
    send: (frame) => this.sent.push(frame),
    hangUp: (why) => (this.wrong = why),
    tell: (message) => this.told.push(message),
    paint: (message) => {
      this.painted.push(message);
      if (message.kind === 'change') this.copy.apply(message);
    },
  });

  constructor(server = 'here:7070') {
    this.core.start(server, 'a test', 1);
    this.core.step();
    this.core.opened();
  }
  hear(frame: Uint8Array): void {
    this.core.heard(frame);
    this.core.taken();
    this.core.step();
  }
  last<Kind extends FromEngine['kind']>(kind: Kind): Extract<FromEngine, { kind: Kind }> | undefined {
    return this.told.filter((message): message is Extract<FromEngine, { kind: Kind }> => message.kind === kind).at(-1);
  }
}

test('hashes are those of the page', () => {
  const page = file('PROTOCOL.md').toString();
  const given = (name: string): bigint => BigInt('0x' + new RegExp(`${name}\\s+([0-9a-f]{16})`).exec(page)![1]);
  assert.equal(mix(0n), given('mix\\(0\\)'));
  assert.equal(hashVertex(-8192, 16384, -1), given('vertex\\(-8192, 16384,  -1\\)'));
  assert.equal(hashVertex(-7936, 16384, 300), given('vertex\\(-7936, 16384, 300\\)'));
  const address = { level: 0, i: -1, j: 2 }, hash = hashLeaf(address, [Int32Array.from([0, 0, -1, 0, 256, 512, 256, 0, 300])]);
  assert.equal(hash, given('vertex\\(-7936, 16384, 300\\)\\s+[0-9a-f]+\\s+leaf'));
  assert.equal(hashTerm(address, hash), given('\\s{20,}mesh'));
});

test('the recorded stream becomes its mesh, on the screen too', () => {
  const held = new Held();
  const said = [...file('example/leaves.txt').toString().matchAll(/^iteration (\d+) leaves (\d+) triangles (\d+) hash ([0-9a-f]+)$/gm)];
  const [world, ...iterations] = frames();
  held.hear(world!);
  assert.equal(held.core.isGreeted, true);
  assert.equal(held.last('world')!.world.terrain, 'canyon');
  assert.equal(said.length, iterations.length);
  iterations.forEach((frame, k) => {
    held.hear(frame);
    assert.equal(held.wrong, '');
    const { iteration, leaves, triangles, hashOk } = held.last('figures')!.figures, [, ...numbers] = said[k]!;
    assert.deepEqual([iteration, leaves, triangles, hashOk], [...numbers.slice(0, 3).map(Number), true]);
    assert.equal(held.copy.triangles, triangles);
    assert.equal(held.copy.hash, BigInt('0x' + numbers[3]));
  });
  const sent = held.sent.map((frame) => fromBinary(ClientMessageSchema, frame).kind);
  assert.equal(sent[0]!.case, 'hello');
  assert.deepEqual(sent.flatMap(({ case: kind, value }) => (kind === 'acknowledge' ? [value.meshHash.toString(16)] : [])), said.map(([, , , , hash]) => hash));
});

const eye: Pose = { x: 40_000, z: 60_000, remainderX: 0.5, remainderZ: 0.25, y: 0, yaw: 0.1, pitch: -0.7 }, window = { pose: eye, width: 640, height: 360, verticalFov: 1 };

test('the brush lies on the ground below the pointer, and what it makes is sent, answered and undone', () => {
  const held = new Held();
  [worldOfToday(), ...frames().slice(1)].forEach((frame) => held.hear(frame));
  eye.y = held.core.heights(Float64Array.of(eye.x, eye.z))[0]! + 300;
  const brush = (x: number, y: number, uses: boolean): Touched | undefined => {
    held.core.brush({ from: eye, towards: towards(window, x, y), uses });
    held.core.step();
    return held.last('touched')!.touched;
  };
  const sent = (): { id: bigint; key: string; operation: { op: string; x: number; z: number; material?: string; line?: number[][]; edit?: number } }[] =>
    held.sent.map((frame) => fromBinary(ClientMessageSchema, frame).kind).flatMap(({ case: kind, value }) => (kind === 'edit' ? [{ id: value.id, key: textOf(value.key), operation: JSON.parse(textOf(value.operation)) }] : []));
  const answer = (number: number, refusal = ''): void => held.hear(toBinary(ServerMessageSchema, create(ServerMessageSchema, { kind: { case: 'editAnswer', value: { id: sent().at(-1)!.id, number: BigInt(number), refusal: new TextEncoder().encode(refusal) } } })));
  const act = (act: Act, by = 0): void => {
    held.core.act(act, by);
    held.core.step();
  };

  assert.deepEqual(held.last('editing')!.editing, { tool: 0, words: 'radius 8 m, 2.7 m deep', mayUndo: false });
  act('choose', TOOLS.indexOf('raise'));
  act('paint', 3);
  act('widen', -5);
  assert.match(held.last('editing')!.editing.words, /^radius 4 m, up 1 m$/);
  const { outline, line } = brush(320, 180, true)!, box = pathOf(outline, window, true).match(/[\d.]+ [\d.]+/g)!.map((p) => p.split(' ').map(Number));
  assert.equal(line.length, 0);
  assert.ok(box.some(([x]) => x! < 320) && box.some(([x]) => x! > 320) && box.some(([, y]) => y! < 180) && box.some(([, y]) => y! > 180), 'around the pointer');
  const [{ operation, key }] = sent() as [ReturnType<typeof sent>[0]], middle = outline.reduce((sum, p) => ({ x: sum.x + p.x / outline.length, z: sum.z + p.z / outline.length }), { x: 0, z: 0 });
  assert.deepEqual([operation.op, operation.material], ['raise', 'gravel']);
  assert.ok(Math.hypot(256 * operation.x - middle.x, 256 * operation.z - middle.z) < 2);
  answer(7);
  assert.equal(held.last('notice')!.sentence, 'Edit 7 made.');
  assert.equal(held.last('editing')!.editing.mayUndo, true);

  act('undo');
  assert.deepEqual(sent()[1]!.operation, { op: 'undo', edit: 7 });
  // Not answered: it goes again over the next line, under the same key.
  held.core.closed('it was cut');
  held.core.hurry();
  held.core.step();
  held.core.opened();
  held.hear(worldOfToday());
  assert.deepEqual(sent()[2]!.operation, { op: 'undo', edit: 7 });
  assert.equal(sent()[2]!.key, sent()[1]!.key);
  assert.notEqual(sent()[2]!.key, key);
  assert.match(key, /^[0-9a-f]{32}$/);
  answer(0, 'No.');
  assert.equal(held.last('notice')!.sentence, 'No.');

  act('choose', TOOLS.indexOf('road'));
  brush(200, 200, true);
  brush(400, 300, true);
  assert.ok(brush(320, 200, false)!.line.length > 2);
  act('end road');
  assert.equal(sent()[3]!.operation.line!.length, 2);
  held.core.brush({ from: eye, towards: [0, 1, 0], uses: true });
  assert.equal(held.last('touched')!.touched, undefined);
  assert.equal(held.last('notice')!.sentence, 'There is no ground.');
});

test('the clock goes on as it is driven, and who may not drive it is told why', () => {
  const held = new Held(), said = (): unknown[] => held.sent.map((frame) => fromBinary(ClientMessageSchema, frame).kind).flatMap(({ case: kind, value }) => (kind === 'setClock' ? [[value.own, value.rate, value.time]] : []));
  held.core.drive('toggle', 0);
  assert.equal(held.last('notice')!.sentence, 'No connection to a server with a clock.');
  held.hear(worldOfToday());
  const clock = (value: MessageInitShape<typeof ClockSchema>): void => held.hear(toBinary(ServerMessageSchema, create(ServerMessageSchema, { kind: { case: 'clock', value } })));
  clock({ mode: 1, rate: 1, time: 60_000_000n });
  assert.deepEqual([held.last('clock')!.clock.runs, held.last('clock')!.clock.rate], [true, 1]);
  held.core.drive('faster', 0);
  held.core.step();
  assert.deepEqual(said(), [[true, 2, 0n], [false, 1, 0n]], 'taken, and left to all');
  assert.equal(held.last('clock')!.clock.rate, 2, 'before the server answers');
  held.core.drive('toggle', 0);
  assert.deepEqual([held.last('clock')!.clock.runs, held.last('clock')!.clock.rate], [false, 2]);
  clock({ mode: 1, rate: 1, time: 61_000_000n, owner: 99n });
  held.core.drive('toggle', 0);
  assert.equal(held.last('notice')!.sentence, 'Member 99 owns the clock.');
});

test('a clock may be set before the server has told of it', () => {
  const held = new Held();
  held.hear(worldOfToday());
  held.core.setClock(4, 0);
  held.core.step();
  const sets = held.sent.map((frame) => fromBinary(ClientMessageSchema, frame).kind).filter(({ case: kind }) => kind === 'setClock');
  assert.equal(sets.length, 2);
  assert.equal(held.last('notice'), undefined);
});

test('frames that are none end the line in a sentence, and what was held is resumed over the next', () => {
  const [world, ...iterations] = frames();
  let random = 12345, refused = 0, wrong = 0;
  const next = (n: number): number => (random = (Math.imul(random, 1103515245) + 12345) >>> 0) % n;
  for (let k = 0; k < 300; ++k) {
    const held = new Held(), at = next(iterations.length);
    held.hear(world!);
    for (let before = 0; before < at; ++before) held.hear(iterations[before]!);
    const frame = iterations[at]!.slice(0, k % 2 === 0 ? next(iterations[at]!.length) : undefined);
    for (let flips = k % 2 === 0 ? 0 : 1 + next(6); flips > 0; --flips) frame[next(frame.length)] = next(256);
    held.hear(frame);
    if (held.wrong) {
      ++refused;
      assert.match(held.wrong, /^the server at here:7070 /);
    } else if (!held.last('figures')!.figures.hashOk) ++wrong;
    held.core.closed('it was cut');
    assert.equal(held.core.comesBack, true);
    held.core.hurry();
    held.core.step();
    assert.deepEqual(held.dialled, [['', true], ['', true]]);
    held.core.opened();
    const { length } = held.sent;
    held.hear(world!);
    if (at > 1 && held.copy.leaves.size > 0) assert.ok(held.sent.length > length, 'what is held is named');
  }
  assert.ok(refused > 50 && wrong > 50, `${refused} refused, ${wrong} with another hash`);
});

test('a server that leaves says where to go: there, without the token of this one, and back', () => {
  const dials = (server: string, reconnectUrl: string): [string, boolean][] => {
    const held = new Held(server);
    held.hear(frames()[0]!);
    held.core.heard(toBinary(ServerMessageSchema, create(ServerMessageSchema, { kind: { case: 'error', value: { code: Error_Code.GOING_AWAY, message: bytes('Bye.'), reconnectUrl: bytes(reconnectUrl) } } })));
    for (let k = 0; k < 2; ++k) {
      held.core.closed('it has left'); // the second one is not there
      held.core.hurry();
      held.core.step();
    }
    return held.dialled.slice(1);
  };
  const back: [string, boolean] = ['', true];
  assert.deepEqual(dials('wss://here:7070', 'wss://there:7071/path?session=other'), [['wss://there:7071', false], back]);
  assert.deepEqual(dials('wss://here', 'https://there'), [['wss://there:443', false], back]);
  assert.deepEqual(dials('ws://here:7070', 'ws://here:7071'), [['ws://here:7071', true], back], 'the same host');
  assert.deepEqual(dials('ws://here:7070', 'ws://[::1]:7071'), [['ws://[::1]:7071', false], back]);
  assert.deepEqual(dials('wss://here:7070', 'ws://there:7071'), [back, back], 'what was encrypted stays so');
  assert.deepEqual(dials('ws://here:7070', 'javascript:alert(1)'), [back, back]);
  assert.deepEqual(dials('ws://here:7070', ''), [back, back]);
});

test('a server of another version is not asked again', () => {
  const held = new Held(), [world] = frames(), camera: Camera = { x: 0, z: 0, y: 0, yaw: 0, pitch: 0, verticalFov: 1, width: 640, height: 360 };
  held.core.pose(camera, 1);
  world!.set([8, 2], 2 + (world![1]! > 127 ? 1 : 0)); // protocol_version
  held.hear(world!);
  assert.match(held.wrong, /version/);
  held.core.closed(held.wrong);
  assert.equal(held.core.comesBack, false);
});

test('where memory ends the core says so', () => {
  assert.throws(() => new Held().core.heard({ length: 4e9 } as Uint8Array), (error) => error instanceof WebAssembly.RuntimeError || error instanceof RangeError);
});
