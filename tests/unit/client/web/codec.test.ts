// The codec against the examples that PROTOCOL.md gives, read from the page itself, and against payloads that are none.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { decodeLeaf } from '../../../../client/web/src/codec/leaf';
import { LeafMesh, Refusal, orientation } from '../../../../client/web/src/codec/mesh';
import { PointMesh } from '../../../../client/web/src/scene/point_mesh';
import { hashLeaf, hashTerm, hashVertex, mix, pointsModule } from '../../../support/web';

const page = readFileSync(join(process.env['RIDGECAST_SOURCE']!, 'proto/PROTOCOL.md'), 'utf8');
const noDraco = (): never => {
  throw new Refusal('no Draco here');
};

/** The hexadecimal number that the page gives for something. */
function given(name: string): bigint {
  const found = new RegExp(`${name}\\s+([0-9a-f]{16})`).exec(page);
  assert.ok(found, name);
  return BigInt('0x' + found[1]);
}
/** The bytes of the example below a sentence. */
function bytesBelow(sentence: string): Uint8Array {
  const found = new RegExp(sentence + '[\\s\\S]*?\\n\\n {4}([0-9a-f ]+)\\n').exec(page);
  assert.ok(found, sentence);
  return Uint8Array.from(found[1]!.trim().split(/ +/), (b) => parseInt(b, 16));
}
const leafOf = (level: number, i: number, j: number, vertices: number[], triangles: number[]): LeafMesh => ({ address: { level, i, j }, vertices: Int32Array.from(vertices), triangles: Uint32Array.from(triangles) });

test('hashes are those of the page', () => {
  assert.equal(mix(0n), given('mix\\(0\\)'));
  assert.equal(hashVertex(-8192, 16384, -1), given('vertex\\(-8192, 16384,  -1\\)'));
  assert.equal(hashVertex(-7936, 16384, 300), given('vertex\\(-7936, 16384, 300\\)'));
  const leaf = leafOf(0, -1, 2, [0, 0, -1, 0, 256, 512, 256, 0, 300], [0, 1, 2]), points = new PointMesh(pointsModule());
  const hash = points.hashLeaf(leaf);
  assert.equal(hash, given('vertex\\(-7936, 16384, 300\\)\\s+[0-9a-f]+\\s+leaf'));
  assert.equal(points.hashTerm(leaf.address, hash), given('\\s{20,}mesh'));

  // Far out, where positions fill 51 bits.
  const far = leafOf(10, -(2 ** 27), 2 ** 27 - 1, [5, 7, -(2 ** 25), 90, 99, 2 ** 25, 91, 12, 0, 92, 80, 3], [1, 2, 0, 2, 1, 3]);
  assert.equal(points.hashLeaf(far), hashLeaf(far));
  assert.equal(points.hashTerm(far.address, 2n ** 64n - 1n), hashTerm(far.address, 2n ** 64n - 1n));
});

test('orientation is exact', () => {
  const v = Int32Array.from([-(2 ** 27), -(2 ** 27), 0, 2 ** 27, 2 ** 27, 0, 2 ** 27 - 1, 2 ** 27 - 1, 0, 2 ** 27, 2 ** 27 - 1, 0]);
  assert.equal(orientation(v, 0, 1, 2), 0);
  assert.ok(orientation(v, 0, 1, 3) > 0);
  assert.ok(orientation(v, 1, 0, 3) < 0);
});

test('the plain form is that of the page', () => {
  const leaf = decodeLeaf(bytesBelow('Example, the triangle'), { level: 0, i: 0, j: 0 }, 3, 1, noDraco);
  assert.deepEqual([...leaf.vertices], [0, 0, 0, 0, 9, 0, 7, 0, 0]);
  assert.deepEqual([...leaf.triangles], [0, 1, 2]);
});

test('what is no payload is refused in a sentence, and soon', () => {
  const whole = bytesBelow('Example, the triangle');
  let random = 12345;
  const next = (n: number): number => (random = (Math.imul(random, 1103515245) + 12345) >>> 0) % n;
  const attempt = (bytes: Uint8Array): void => {
    try {
      decodeLeaf(bytes, { level: next(11), i: next(5) - 2, j: 0 }, 3 + next(3), 1 + next(4), noDraco);
    } catch (error) {
      assert.ok(error instanceof Refusal, String(error));
    }
  };
  for (let n = 0; n < whole.length; ++n) attempt(whole.slice(0, n));
  for (let k = 0; k < 20_000; ++k) {
    const bytes = Uint8Array.from([...whole, ...Array.from({ length: next(20) }, () => next(256))]);
    for (let flips = 1 + next(6); flips > 0; --flips) bytes[next(bytes.length)] = next(256);
    attempt(bytes);
  }
});
