// The recorded stream of proto/example through the page's own scene: every leaf as leaves.txt says.

import { fromBinary } from '@bufbuild/protobuf';
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { test } from 'node:test';
import { loadDraco } from '../../../../client/web/src/codec/draco';
import { LeafAddress, keyOf } from '../../../../client/web/src/codec/mesh';
import { ServerMessageSchema } from '../../../../client/web/src/generated/ridgecast/v1/stream_pb';
import { Scene } from '../../../../client/web/src/scene/scene';

const file = (name: string): Buffer => readFileSync(join(process.env['RIDGECAST_SOURCE']!, 'proto/example', name));

test('the recorded stream decodes to its leaves', async () => {
  const require = createRequire(join(process.env['RIDGECAST_WEB']!, 'package.json'));
  const wasm = readFileSync(require.resolve('draco3d/draco_decoder.wasm'));
  const scene = new Scene(await loadDraco(require('draco3d/draco_decoder_nodejs.js'), Uint8Array.from(wasm).buffer));
  const stream = file('stream.bin'), lines: string[] = [];
  const list = (letter: string, numbers: Iterable<number>): void => {
    const all = [...numbers];
    for (let k = 0; k < all.length; k += 3) lines.push(`${letter} ${all[k]} ${all[k + 1]} ${all[k + 2]}`);
  };
  for (let at = 0; at < stream.length; at += 4 + stream.readUInt32LE(at)) {
    const message = fromBinary(ServerMessageSchema, stream.subarray(at + 4, at + 4 + stream.readUInt32LE(at)));
    if (message.kind.case !== 'iteration') continue;
    const iteration = message.kind.value;
    scene.apply(iteration);
    assert.equal(scene.damaged, false);
    assert.equal(scene.hash, iteration.meshHash);
    lines.push(`iteration ${iteration.number} leaves ${scene.leaves.size} triangles ${scene.triangles} hash ${scene.hash.toString(16)}`);
    for (const a of iteration.gone) lines.push(`gone ${a.level} ${a.i} ${a.j}`);
    const brought = (how: string, wire: { level: number; i: bigint; j: bigint }): void => {
      const address: LeafAddress = { level: wire.level, i: Number(wire.i), j: Number(wire.j) };
      const held = scene.leaves.get(keyOf(address))!;
      lines.push(`${how} ${address.level} ${address.i} ${address.j} hash ${held.hash.toString(16)}`);
      list('v', held.mesh.vertices);
      list('t', held.mesh.triangles);
    };
    for (const leaf of iteration.whole) brought('whole', leaf.address!);
    for (const leaf of iteration.changed) brought('changed', leaf.address!);
  }
  assert.equal(lines.join('\n') + '\n', file('leaves.txt').toString());
});
