// The C++ client's triangulation as WebAssembly: what is no payload, and where memory ends. Sound streams: example.test.ts.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { LeafMesh, Refusal, canonical } from '../../../../client/web/src/codec/mesh';
import { PointMesh } from '../../../../client/web/src/scene/point_mesh';
import { hashLeaf, pointsModule } from '../../../support/web';

const address = { level: 0, i: -3, j: 7 };
const leaf: LeafMesh = { address, vertices: Int32Array.from([0, 0, 5, 0, 512, 0, 512, 0, 0, 600, 512, 9]), triangles: Uint32Array.from([0, 1, 2, 1, 3, 2]) };

function holdsTheLeaf(points: PointMesh): void {
  const [changed, ...others] = points.takeChanged();
  assert.equal(others.length, 0);
  assert.equal(changed!.hash, hashLeaf(leaf));
  const made = points.extract(changed!.address);
  assert.deepEqual(canonical(address, made.vertices, made.triangles), leaf);
  assert.deepEqual([changed!.triangles, changed!.low, changed!.high], [2, [0, 0, 0], [600, 512, 9]]);
}

test('what is no payload is refused, and the mesh can begin again', () => {
  const points = new PointMesh(pointsModule());
  let random = 12345, followed = 0;
  const next = (n: number): number => (random = (Math.imul(random, 1103515245) + 12345) >>> 0) % n;
  for (let k = 0; k < 20_000; ++k) {
    assert.ok(points.begin([leaf]));
    if (k % 100 === 0) holdsTheLeaf(points);
    const payload = Uint8Array.from({ length: 1 + next(40) }, () => next(256));
    if (next(8) > 0) payload[0] = 0x30;
    if (points.follow([], [], payload)) ++followed;
  }
  assert.ok(followed < 2_000, `${followed}`);
});

test('where memory ends is a refusal, and the mesh can begin again', () => {
  const points = new PointMesh(pointsModule());
  const endless = { address, vertices: { byteLength: 4e9, length: 3 } as Int32Array, triangles: new Uint32Array(0) };
  for (let k = 0; k < 2; ++k) {
    assert.ok(points.begin([leaf]));
    holdsTheLeaf(points);
    assert.throws(() => points.hashLeaf(endless), Refusal);
    assert.equal(points.takeChanged().length, 0);
  }
});
