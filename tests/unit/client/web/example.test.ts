// The recorded stream of proto/example through the page's own scene: every leaf as leaves.txt says.

import { fromBinary } from '@bufbuild/protobuf';
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { LeafAddress, canonical, keyOf } from '../../../../client/web/src/codec/mesh';
import { ServerMessageSchema, LeafAddress as WireAddress } from '../../../../client/web/src/generated/ridgecast/v1/stream_pb';
import { PointMesh } from '../../../../client/web/src/scene/point_mesh';
import { Scene } from '../../../../client/web/src/scene/scene';
import { parts } from '../../../support/web';

const file = (name: string): Buffer => readFileSync(join(process.env['RIDGECAST_SOURCE']!, 'proto/example', name));

test('the recorded stream decodes to its leaves', async () => {
  const { draco, points } = await parts(), scene = new Scene(draco, new PointMesh(points));
  const stream = file('stream.bin'), lines: string[] = [];
  const list = (letter: string, numbers: Iterable<number>): void => {
    const all = [...numbers];
    for (let k = 0; k < all.length; k += 3) lines.push(`${letter} ${all[k]} ${all[k + 1]} ${all[k + 2]}`);
  };
  for (let at = 0; at < stream.length; at += 4 + stream.readUInt32LE(at)) {
    const message = fromBinary(ServerMessageSchema, stream.subarray(at + 4, at + 4 + stream.readUInt32LE(at)));
    if (message.kind.case !== 'iteration') continue;
    const iteration = message.kind.value;
    const { fresh } = scene.apply(iteration);
    assert.equal(scene.lost, false);
    assert.equal(scene.hash, iteration.meshHash);
    lines.push(`iteration ${iteration.number} leaves ${scene.leaves.size} triangles ${scene.triangles} hash ${scene.hash.toString(16)}`);
    for (const a of iteration.gone) lines.push(`gone ${a.level} ${a.i} ${a.j}`);
    const brought = (how: string, address: LeafAddress): void => {
      const held = scene.leaves.get(keyOf(address))!, { vertices, triangles } = canonical(address, held.mesh.vertices, held.mesh.triangles);
      lines.push(`${how} ${address.level} ${address.i} ${address.j} hash ${held.hash.toString(16)}`);
      list('v', vertices);
      list('t', triangles);
    };
    const local = (wire: WireAddress): LeafAddress => ({ level: wire.level, i: Number(wire.i), j: Number(wire.j) });
    for (const leaf of iteration.whole) brought('whole', local(leaf.address!));
    const come = new Set(iteration.come.map((wire) => keyOf(local(wire)))), made = iteration.whole.length > 0 ? [] : fresh.map(({ mesh }) => mesh.address);
    for (const a of made.sort((l, r) => l.level - r.level || l.i - r.i || l.j - r.j)) brought(come.has(keyOf(a)) ? 'come' : 'changed', a);
  }
  assert.equal(lines.join('\n') + '\n', file('leaves.txt').toString());
});
