// The page's decoder, in node, against the real server: after every iteration of a flight it holds exactly what the server has.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { LeafAddress, keyOf } from '../../../client/web/src/codec/mesh';
import type { Iteration, World } from '../../../client/web/src/generated/ridgecast/v1/stream_pb';
import { Replica } from '../../../client/web/src/replica/replica';
import { BLOCK, SLOT } from '../../../client/web/src/scene/point_mesh';
import type { Change, Scene } from '../../../client/web/src/scene/scene';
import { Camera, Stream } from '../../../client/web/src/stream/stream';
import { hashLeaf, hashTerm, parts } from '../../support/web';
import { NodeSocket } from './node_socket';
import { randomFrom } from './random';
import { Server } from './server';

const forms = { plain: 0, draco: 0, points: 0, come: 0, gone: 0 }; // how leaves came and went

/** Flies in lock-step; resolves once `cameras` have had their iterations. */
async function fly(server: Server, replica: Replica, cameras: Camera[], more: { damage?: boolean; copy?: Copy } = {}): Promise<{ triangles: number; damages: number; times: number[] }> {
  return new Promise((resolve, reject) => {
    let next = 0, triangles = 0, damages = 0, requests = 0;
    const times: number[] = [], copy = more.copy ?? new Copy();
    const socket = new NodeSocket(`${server.ws}/v1/stream`);
    const stream: Stream = new Stream(
      { open: () => socket, clientName: 'test', settings: { threshold: 1, candidates: 0 }, lockstep: true },
      {
        onWorld: (world: World) => {
          assert.equal(world.stepBits, 8);
          setTimeout(() => stream.pose(cameras[next++]!));
          return replica.resume(world, { acknowledge: (number, hash) => stream.acknowledge(number, hash), resend: () => (++requests, stream.resend()) });
        },
        onIteration: (iteration: Iteration) => {
          for (const w of iteration.whole) if (w.payload.length > 0) w.payload[0] === 0x11 ? ++forms.draco : ++forms.plain;
          forms.points += iteration.points.length;
          forms.come += iteration.come.length;
          forms.gone += iteration.gone.length;
          // A bit that is wrong must be noticed, and mended by the server with the next iteration.
          const damaged = more.damage && iteration.number % 4n === 0n && iteration.points.length > 8;
          if (damaged) iteration.points[(++damages * 7919) % iteration.points.length]! ^= 1 << damages % 8;
          const began = performance.now();
          const applied = replica.apply(iteration), { decoded, agrees, acknowledge } = applied;
          times.push(performance.now() - began);
          copy.apply(applied);
          if (iteration.number % 16n === 0n && agrees) copy.check(replica.scene);
          triangles += decoded;
          assert.equal(agrees, !damaged, `iteration ${iteration.number}`);
          assert.equal(requests, damages);
          acknowledge();
          // Iterations that see nothing come faster than the server takes messages.
          if (next < cameras.length) return void setTimeout(() => stream.pose(cameras[next++]!), 1);
          stream.close();
          resolve({ triangles, damages, times });
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

/** What somebody draws who keeps a copy of the slots. */
class Copy {
  private readonly leaves = new Map<string, { address: LeafAddress; blocks: Uint32Array }>();
  private readonly slots = new Map<number, Int32Array>();

  apply({ gone, drawn, drawing: { ends, blocks, changed, corners } }: Change): void {
    for (const address of gone) this.leaves.delete(keyOf(address));
    changed.forEach((slot, k) => this.slots.set(slot, corners.subarray(SLOT * k, SLOT * (k + 1))));
    drawn.forEach(({ address }, k) => this.leaves.set(keyOf(address), { address, blocks: blocks.subarray(k === 0 ? 0 : ends[k - 1], ends[k]) }));
  }

  /** They are the triangles that the hashes tell of. */
  check({ leaves }: Scene): void {
    assert.deepEqual([...this.leaves.keys()].sort(), [...leaves.keys()].sort());
    const owned = [...this.leaves.values()].flatMap(({ blocks }) => [...blocks]);
    assert.equal(new Set(owned).size, owned.length);
    for (const [key, { address, blocks }] of this.leaves) {
      const vertices: number[] = [];
      for (const block of blocks)
        for (let k = 0; k < BLOCK; ++k) {
          const corners = this.slots.get(BLOCK * block + k)!;
          if (corners.some((v) => v !== 0)) vertices.push(...corners);
        }
      assert.equal(hashLeaf({ address, vertices: Int32Array.from(vertices), triangles: Uint32Array.from({ length: vertices.length / 3 }, (_, k) => k) }), leaves.get(key)!.hash);
    }
  }
}

/** The hashes that points were compared by are those of the leaves that are held, reckoned by other code. */
function checkHashes({ scene }: Replica): void {
  let sum = 0n;
  for (const { mesh, hash } of scene.leaves.values()) {
    assert.equal(hashLeaf(mesh), hash);
    sum += hashTerm(mesh.address, hash);
  }
  assert.equal(BigInt.asUintN(64, sum), scene.hash);
}

for (const terrain of ['alpine', 'canyon'])
  test(`every iteration of a flight over ${terrain} has the hash that the server says`, async (t) => {
    const server = await Server.start(['--terrain', terrain, '--seed', '1']);
    t.after(() => server.stop());
    const { draco, points } = await parts();

    const replica = new Replica(draco, points), { scene } = replica, copy = new Copy();
    const { triangles, times } = await fly(server, replica, flight(358_400, 921_600, 120), { copy });
    times.sort((a, b) => a - b);
    t.diagnostic(`${triangles} triangles came; an iteration took ${times[60]!.toFixed(1)} ms, one ${times[118]!.toFixed(1)}; ${JSON.stringify(forms)}`);
    assert.ok(scene.triangles > 10_000);
    assert.ok(forms.points > 10_000 && forms.come > 100 && forms.gone > 100, JSON.stringify(forms));
    checkHashes(replica);

    await t.test('resumes on a new connection', async () => {
      const before = scene.triangles;
      const { triangles: again } = await fly(server, replica, flight(358_400 + 119 * 12_000, 921_600 - 119 * 36_000, 3, 0), { copy });
      copy.check(scene);
      assert.ok(again < before / 2, `${again} of ${before} came again`);
    });
    await t.test('far away', () => fly(server, new Replica(draco, points), flight(2 ** 50 - 2 ** 30, -(2 ** 49), 6)));
    await t.test('damaged points are noticed and mended', async () => {
      const mended = new Replica(draco, points);
      const { damages } = await fly(server, mended, flight(358_400, 921_600, 41), { damage: true });
      assert.ok(damages >= 8, `${damages}`);
      assert.ok(forms.draco > 0 && forms.plain > 10, JSON.stringify(forms));
      checkHashes(mended);
    });
  });

// FLIGHTS=200 STEPS=100: more of them, and longer ones; FLIGHTS=3 STEPS=36000: an hour over each terrain.
test('random flights have the hashes that the server says', async (t) => {
  const flights = Number(process.env.FLIGHTS ?? 3), steps = Number(process.env.STEPS ?? 30);
  const random = randomFrom(1);
  const terrains = ['alpine', 'canyon', 'archipelago'];
  const servers = await Promise.all(terrains.map((terrain) => Server.start(['--terrain', terrain, '--seed', '5'])));
  t.after(() => Promise.all(servers.map((server) => server.stop())));
  const { draco, points } = await parts();
  for (let n = 0; n < flights; ++n) {
    const reach = 2 ** random(0, 49), speed = 2 ** random(4, 16), height = 2 ** random(10, 13), turn = random(-0.1, 0.1), yaw = random(-3, 3), pitch = random(-1.4, 0.3);
    const start = [Math.round(random(-reach, reach)), Math.round(random(-reach, reach))] as const;
    let [x, z] = start;
    const cameras = Array.from({ length: steps }, (_, k): Camera => {
      const heading = yaw + k * turn;
      x -= Math.round(speed * Math.sin(heading));
      z -= Math.round(speed * Math.cos(heading));
      return { x, z, y: height, yaw: heading, pitch, verticalFov: 1.0472, width: 640, height: 360 };
    });
    const replica = new Replica(draco, points), { triangles } = await fly(servers[n % 3]!, replica, cameras);
    checkHashes(replica);
    t.diagnostic(`${terrains[n % 3]} at ${start}: ${triangles} triangles came, ${replica.scene.triangles} are held`);
  }
});
