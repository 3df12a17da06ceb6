// The codec against the examples that PROTOCOL.md gives, read from the page itself, and against payloads that are none.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { decodeDelta } from '../../../../client/web/src/codec/delta';
import { Sum, hashVertex, mix, out } from '../../../../client/web/src/codec/hash';
import { decodeLeaf } from '../../../../client/web/src/codec/leaf';
import { LeafMesh, Refusal, canonical, gather, hashLeaf, hashTerm, orientation } from '../../../../client/web/src/codec/mesh';

const page = readFileSync(join(process.env['RIDGECAST_SOURCE']!, 'proto/PROTOCOL.md'), 'utf8');
const noDraco = (): never => {
  throw new Refusal('no Draco here');
};
const last = (): bigint => new Sum(out[0]!, out[1]!).value;

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
  mix(0, 0);
  assert.equal(last(), given('mix\\(0\\)'));
  hashVertex(-8192, 16384, -1);
  assert.equal(last(), given('vertex\\(-8192, 16384,  -1\\)'));
  hashVertex(-7936, 16384, 300);
  assert.equal(last(), given('vertex\\(-7936, 16384, 300\\)'));
  const leaf = leafOf(0, -1, 2, [0, 0, -1, 0, 256, 512, 256, 0, 300], [0, 1, 2]);
  const hash = hashLeaf(leaf);
  assert.equal(hash, given('vertex\\(-7936, 16384, 300\\)\\s+[0-9a-f]+\\s+leaf'));
  assert.equal(hashTerm(leaf.address, hash), given('\\s{20,}mesh'));
});

test('mix agrees with arithmetic in whole numbers', () => {
  const mask = (1n << 64n) - 1n;
  const slow = (v: bigint): bigint => {
    v = (v + 0x9e3779b97f4a7c15n) & mask;
    v = ((v ^ (v >> 30n)) * 0xbf58476d1ce4e5b9n) & mask;
    v = ((v ^ (v >> 27n)) * 0x94d049bb133111ebn) & mask;
    return v ^ (v >> 31n);
  };
  let v = 1n;
  for (let k = 0; k < 5000; ++k) {
    mix(Number(BigInt.asIntN(32, v >> 32n)), Number(BigInt.asIntN(32, v)));
    assert.equal(last(), slow(v));
    v = (slow(v) + BigInt(k)) & mask;
  }
  // Far out, where positions fill 51 bits.
  const x = -(2 ** 50) + 12_345, z = 2 ** 50 - 1, y = -(2 ** 25);
  hashVertex(x, z, y);
  const wide = (n: number): bigint => BigInt(n) & mask;
  assert.equal(last(), slow((wide(x) + slow((wide(z) + slow(wide(y))) & mask)) & mask));
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

const square = leafOf(0, 0, 0, [0, 0, 0, 0, 512, 0, 512, 0, 0, 512, 512, 0], [0, 1, 2, 1, 3, 2]);

test('the delta is that of the page', () => {
  const { leaf, hash } = decodeDelta(bytesBelow('which makes four:'), square, hashLeaf(square));
  assert.deepEqual([...leaf.vertices], [0, 0, 0, 0, 512, 0, 256, 256, 100, 512, 0, 0, 512, 512, 0]);
  assert.equal(leaf.triangles.length, 12);
  assert.equal(hashLeaf(leaf), hash);
  assert.deepEqual(canonical(leaf.address, leaf.vertices, leaf.triangles), leaf);
  assert.equal(decodeDelta(new Uint8Array(0), square, 7n).leaf, square);
});

test('what is no payload is refused in a sentence, and soon', () => {
  const whole = bytesBelow('Example, the triangle'), delta = bytesBelow('which makes four:');
  let random = 12345;
  const next = (n: number): number => (random = (Math.imul(random, 1103515245) + 12345) >>> 0) % n;
  const attempt = (bytes: Uint8Array): void => {
    for (const decode of [
      () => decodeLeaf(bytes, { level: next(11), i: next(5) - 2, j: 0 }, 3 + next(3), 1 + next(4), noDraco),
      () => decodeDelta(bytes, square, 0n),
    ])
      try {
        decode();
      } catch (error) {
        assert.ok(error instanceof Refusal, String(error));
      }
  };
  for (const good of [whole, delta]) {
    for (let n = 0; n < good.length; ++n) attempt(good.slice(0, n));
    for (let k = 0; k < 20_000; ++k) {
      const bytes = Uint8Array.from([...good, ...Array.from({ length: next(20) }, () => next(256))]);
      for (let flips = 1 + next(6); flips > 0; --flips) bytes[next(bytes.length)] = next(256);
      attempt(bytes);
    }
  }
});

test('gathering takes what lies in the square, by its centroid', () => {
  // Two level 0 leaves into their parent, which begins where the left one does.
  const left = leafOf(0, 2, 4, [0, 0, 5, 0, 8192, 5, 8192, 0, 5], [0, 1, 2]);
  const right = leafOf(0, 3, 4, [0, 0, 5, 0, 8192, 6, 8192, 0, 7], [0, 1, 2]);
  const parent = gather({ level: 1, i: 1, j: 2 }, [left, right]);
  assert.deepEqual([...parent.vertices], [0, 0, 5, 0, 8192, 5, 8192, 0, 5, 8192, 8192, 6, 16384, 0, 7]);
  assert.equal(parent.triangles.length, 6);
  assert.deepEqual([...gather(right.address, [leafOf(1, 1, 2, [8192, 0, 5, 8192, 8192, 6, 16384, 0, 7], [0, 1, 2])]).vertices], [...right.vertices]);
});
