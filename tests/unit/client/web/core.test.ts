// The core in WebAssembly, without a socket: the recorded stream of proto/example, hashes as PROTOCOL.md gives them, what lies under a
// brush, frames that are none, and the end of memory. What the core is, its C++ tests judge.

import { fromBinary } from '@bufbuild/protobuf';
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { Core } from '../../../../client/web/src/core/core';
import { ClientMessageSchema } from '../../../../client/web/src/generated/ridgecast/v1/stream_pb';
import type { Brush, Camera, FromEngine, Place, ToPainterFromEngine } from '../../../../client/web/src/messages';
import type { Pose } from '../../../../client/web/src/render/view';
import { pathOf, towards } from '../../../../client/web/src/ui/outline';
import { Copy, hashLeaf, hashTerm, hashVertex, mix, parts } from '../../../support/web';

const file = (name: string): Buffer => readFileSync(join(process.env['RIDGECAST_SOURCE']!, 'proto', name));
const loaded = await parts();

function frames(): Uint8Array[] {
  const stream = file('example/stream.bin'), out: Uint8Array[] = [];
  for (let at = 0; at < stream.length; at += 4 + stream.readUInt32LE(at)) out.push(Uint8Array.from(stream.subarray(at + 4, at + 4 + stream.readUInt32LE(at))));
  return out;
}

/** A core whose line has been opened, and what it says. */
class Held {
  readonly copy = new Copy();
  readonly told: FromEngine[] = [];
  readonly painted: ToPainterFromEngine[] = [];
  readonly sent: Uint8Array[] = [];
  dialled = 0;
  wrong = '';
  readonly core = new Core(loaded.core, loaded.draco, {
    dial: () => ++this.dialled,
    send: (frame) => this.sent.push(frame),
    hangUp: (why) => (this.wrong = why),
    tell: (message) => this.told.push(message),
    paint: (message) => {
      this.painted.push(message);
      if (message.kind === 'change') this.copy.apply(message);
    },
  });

  constructor() {
    this.core.start('here:7070', 'a test', 1);
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

test('a ray meets the mesh where it is, and the outline and the line lie on it', () => {
  const held = new Held(), heights = (p: Place): number | undefined => {
    for (const { leaf } of held.copy.leaves.values()) {
      const side = 2 ** (13 + leaf.address.level), x = p.x - leaf.address.i * side, z = p.z - leaf.address.j * side;
      if (x < leaf.low[0] || x > leaf.high[0] || z < leaf.low[1] || z > leaf.high[1]) continue;
      for (const t of held.copy.trianglesOf(leaf.key)) {
        const weight = (a: number, b: number): number => (t[b + 1]! - t[a + 1]!) * (x - t[a]!) - (t[b]! - t[a]!) * (z - t[a + 1]!);
        const [a, b, c] = [weight(3, 6), weight(6, 0), weight(0, 3)] as const;
        if (a >= 0 && b >= 0 && c >= 0) return (a * t[2]! + b * t[5]! + c * t[8]!) / (a + b + c) / 256;
      }
    }
    return undefined;
  };
  frames().forEach((frame) => held.hear(frame));
  const eye: Pose = { x: 40_000, z: 60_000, remainderX: 0.5, remainderZ: 0.25, y: 0, yaw: 0.1, pitch: -0.7 }, frame = { pose: eye, width: 640, height: 360, verticalFov: 1 };
  eye.y = heights({ ...eye })! + 300;
  const ask = (brush: Brush): NonNullable<ReturnType<typeof held.last<'touched'>>> => {
    held.core.brush(brush);
    return held.last('touched')!;
  };
  for (const [x, y] of [[320, 180], [200, 200], [400, 300]] as const) {
    const corner: Place = { x: eye.x - 3000, z: eye.z - 9000, y: 0 }, middle: Place = { x: eye.x + 2000, z: eye.z - 12_000, y: 0 };
    const { at, outline, line } = ask({ number: 1, from: eye, towards: towards(frame, x, y), radius: 2, line: [corner, middle] }).touched!;
    assert.ok(Math.abs(at.y - heights(at)!) < 0.1, `${at.y - heights(at)!} m above the mesh`);
    for (const p of [...outline, ...line.slice(0, -1)]) assert.ok(Math.abs(p.y - heights(p)!) < 1e-6);
    for (const p of outline) assert.ok(Math.abs(Math.hypot(p.x - at.x, p.z - at.z) - 512) < 1);
    // On the ray: seen from the eye, the place lies below the pointer.
    const path = pathOf([at, at], frame, false), [px, py] = /^M([\d.]+) ([\d.]+)/.exec(path)!.slice(1).map(Number);
    assert.ok(Math.hypot(px! - x, py! - y) < 0.2, `${path} is not ${x} ${y}`);
    assert.deepEqual([line[0]!.x, line[0]!.z, line.at(-1)], [corner.x, corner.z, at]);
    assert.ok(line.some((p) => p.x === middle.x && p.z === middle.z));
    for (let k = 1; k < line.length; ++k) assert.ok(Math.hypot(line[k]!.x - line[k - 1]!.x, line[k]!.z - line[k - 1]!.z) <= 4 * 256 + 2);
  }
  assert.equal(ask({ number: 2, from: eye, towards: [0, 1, 0], radius: 2, line: [] }).touched, undefined, 'the sky');
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
    assert.equal(held.dialled, 2);
    held.core.opened();
    const { length } = held.sent;
    held.hear(world!);
    if (at > 1 && held.copy.leaves.size > 0) assert.ok(held.sent.length > length, 'what is held is named');
  }
  assert.ok(refused > 50 && wrong > 50, `${refused} refused, ${wrong} with another hash`);
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
