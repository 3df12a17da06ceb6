// The page's decoder, in node, against the real server: after every iteration of a flight it holds exactly what the server has.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { test } from 'node:test';
import { DracoDecode } from '../../../client/web/src/codec/leaf';
import { loadDraco } from '../../../client/web/src/codec/draco';
import { hashLeaf, hashTerm } from '../../../client/web/src/codec/mesh';
import type { Iteration, World } from '../../../client/web/src/generated/ridgecast/v1/stream_pb';
import { Replica } from '../../../client/web/src/replica/replica';
import { Camera, Stream } from '../../../client/web/src/stream/stream';
import { NodeSocket } from './node_socket';
import { Server, needed } from './server';

async function draco(): Promise<DracoDecode> {
  const require = createRequire(needed('RIDGECAST_WEB') + '/');
  const wasm = readFileSync(require.resolve('draco3d/draco_decoder.wasm'));
  return loadDraco(require('draco3d/draco_decoder_nodejs.js'), wasm.buffer.slice(wasm.byteOffset, wasm.byteOffset + wasm.length) as ArrayBuffer);
}

const forms = { plain: 0, draco: 0, delta: 0, moved: 0 }; // how leaves came

/** Flies in lock-step; resolves once `cameras` have had their iterations. */
async function fly(server: Server, replica: Replica, cameras: Camera[], more: { damage?: boolean } = {}): Promise<{ triangles: number; settled: boolean }> {
  return new Promise((resolve, reject) => {
    const again: number[] = []; // how many leaves were asked for again, each time
    let next = 0, triangles = 0, damages = 0;
    const socket = new NodeSocket(`${server.ws}/v1/stream`);
    const stream: Stream = new Stream(
      { open: () => socket, clientName: 'test', settings: { threshold: 1, candidates: 0 }, lockstep: true },
      {
        onWorld: (world: World) => {
          assert.equal(world.stepBits, 8);
          setTimeout(() => stream.pose(cameras[next++]!));
          return replica.resume(world, { acknowledge: (number, hash) => stream.acknowledge(number, hash), resend: (leaves) => (again.push(leaves.length), stream.resend(leaves)) });
        },
        onIteration: (iteration: Iteration) => {
          for (const w of iteration.whole) if (w.payload.length > 0) w.payload[0] === 0x11 ? ++forms.draco : ++forms.plain;
          for (const c of iteration.changed) c.payload.length > 0 ? ++forms.delta : ++forms.moved;
          // A byte that is wrong in the middle of a delta must be noticed, and mended by the server.
          const damaged = more.damage && damages === 0 ? iteration.changed.find((c) => c.payload.length > 40) : undefined;
          if (damaged) damaged.payload[20]! ^= 0x55, ++damages;
          const { decoded, agrees, acknowledge } = replica.apply(iteration);
          triangles += decoded;
          if (damaged) assert.deepEqual(again, [1]);
          if (!damaged && !replica.scene.damaged) assert.ok(agrees, `iteration ${iteration.number}`);
          acknowledge();
          if (next < cameras.length) return void stream.pose(cameras[next++]!);
          if (more.damage) assert.equal(damages, 1);
          else assert.deepEqual(again, []);
          stream.close();
          resolve({ triangles, settled: iteration.settled });
        },
        onLost: ({ sentence }) => {
          stream.close();
          reject(new Error(sentence));
        },
      },
    );
  });
}

const flight = (x: number, z: number, steps: number, speed = 12_000): Camera[] =>
  Array.from({ length: steps }, (_, k) => ({ x: x + k * speed, z: z - k * 3 * speed, y: 2600, yaw: -0.3 + 0.02 * k, pitch: -0.2, verticalFov: 1.0472, width: 640, height: 360 }));

test('every iteration of a flight has the hash that the server says', async (t) => {
  const server = await Server.start(['--terrain', 'alpine', '--seed', '1']);
  t.after(() => server.stop());
  const decode = await draco();

  const replica = new Replica(decode), { scene } = replica;
  const began = performance.now();
  const { triangles } = await fly(server, replica, flight(358_400, 921_600, 40));
  t.diagnostic(`${triangles} triangles came in ${Math.round(performance.now() - began)} ms; forms ${JSON.stringify(forms)}`);
  assert.ok(scene.triangles > 10_000);
  assert.ok(forms.delta > 100 && forms.draco > 0 && forms.plain > 10 && forms.moved > 0, JSON.stringify(forms));

  // The hashes that deltas carried on are those of the leaves that are held.
  let sum = 0n;
  for (const leaf of scene.leaves.values()) {
    assert.equal(hashLeaf(leaf.mesh), leaf.hash);
    sum += hashTerm(leaf.mesh.address, leaf.hash);
  }
  assert.equal(BigInt.asUintN(64, sum), scene.hash);

  await t.test('resumes on a new connection', async () => {
    const before = scene.triangles;
    const { triangles: again } = await fly(server, replica, flight(358_400 + 39 * 12_000, 921_600 - 39 * 36_000, 3, 0));
    assert.ok(again < before / 2, `${again} of ${before} came again`);
  });
  await t.test('far away', () => fly(server, new Replica(decode), flight(2 ** 50 - 2 ** 30, -(2 ** 49), 6)));
  await t.test('a damaged delta is noticed and mended', () => fly(server, new Replica(decode), flight(358_400, 921_600, 12), { damage: true }));
});
