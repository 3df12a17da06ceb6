// The page's core, in node, against the real server: after every iteration of a flight it holds exactly what the server has, and so does
// who draws it.

import assert from 'node:assert/strict';
import { fromBinary, toBinary } from '@bufbuild/protobuf';
import { test } from 'node:test';
import { Core } from '../../../client/web/src/core/core';
import { Line } from '../../../client/web/src/engine/line';
import type { Parts } from '../../../client/web/src/engine/engine';
import { ServerMessageSchema } from '../../../client/web/src/generated/ridgecast/v1/stream_pb';
import type { Camera, Figures } from '../../../client/web/src/messages';
import { Copy, parts } from '../../support/web';
import { NodeSocket } from './node_socket';
import { randomFrom } from './random';
import { Server, sleep } from './server';

const PATIENCE = 60_000; // ms
const STEPS = 60;
const forms = { plain: 0, draco: 0, points: 0, come: 0, gone: 0 }; // how leaves came and went
const loaded: Parts = await parts();

/** Notes how leaves came. Of every fourth iteration with points one bit is turned, where that is wanted: the next one must mend it. */
class Watched extends NodeSocket {
  hash = 0n; // the server's, of the last iteration
  damages = 0;

  constructor(url: string, damage: boolean) {
    super(url);
    let hear: ((event: { data: unknown }) => void) | null = null;
    const watch = ({ data }: { data: unknown }): void => {
      const message = fromBinary(ServerMessageSchema, new Uint8Array(data as ArrayBuffer)), iteration = message.kind.value;
      if (message.kind.case !== 'iteration' || iteration?.$typeName !== 'ridgecast.v1.Iteration') return hear?.({ data });
      this.hash = iteration.meshHash;
      for (const { payload } of iteration.whole) if (payload.length > 0) payload[0] === 0x11 ? ++forms.draco : ++forms.plain;
      forms.points += iteration.points.length;
      forms.come += iteration.come.length;
      forms.gone += iteration.gone.length;
      if (!damage || iteration.number % 4n !== 0n || iteration.points.length <= 8) return hear?.({ data });
      iteration.points[(++this.damages * 7919) % iteration.points.length]! ^= 1 << this.damages % 8;
      hear?.({ data: Uint8Array.from(toBinary(ServerMessageSchema, message)).buffer });
    };
    Object.defineProperty(this, 'onmessage', { get: () => (hear ? watch : null), set: (to: typeof hear) => (hear = to) });
  }
}

class Client {
  readonly copy = new Copy();
  figures: Figures | undefined;
  times: number[] = []; // milliseconds of each iteration
  lost: string | undefined;
  socket!: Watched;
  private heard = (): void => {};
  private poses = 0;
  readonly core = new Core(loaded.core, loaded.draco, {
    dial: (elsewhere, showsToken) => this.line.dial(elsewhere, showsToken),
    send: (frame) => this.line.send(frame),
    hangUp: (why) => this.line.hangUp(why),
    tell: (message) => {
      if (message.kind !== 'figures') return;
      if (message.figures.iteration !== this.figures?.iteration) this.times.push(performance.now() - this.line.heardAt);
      this.figures = message.figures;
      setTimeout(() => this.heard());
    },
    paint: (message) => {
      if (message.kind === 'change') this.copy.apply(message);
      if (message.kind === 'change' || message.kind === 'squares') setTimeout(() => (this.core.taken(), this.line.go()));
    },
  });
  private line!: Line;

  constructor(private readonly server: Server, private readonly damage = false) {}

  begin(): void {
    this.line = new Line(this.core, {
      open: () => (this.socket = new Watched(`${this.server.ws}/v1/stream`, this.damage)),
      onLost: ({ sentence }) => {
        this.lost = sentence;
        this.heard();
      },
    });
    this.core.start(new URL(this.server.http).host, 'test', 1);
    this.line.go();
  }
  end(): void {
    this.line.close();
  }

  /** Gives each pose when an iteration has come since the one before; `each` then. */
  async fly(cameras: Camera[], each: (figures: Figures, hash: bigint) => void): Promise<void> {
    for (const camera of cameras) {
      const last = this.figures?.iteration ?? 0;
      this.core.pose(camera, ++this.poses);
      this.line.go();
      while (this.figures === undefined || this.figures.iteration === last) await Promise.race([new Promise<void>((done) => (this.heard = done)), sleep(PATIENCE, true).then(() => assert.fail('no iteration comes'))]);
      assert.equal(this.lost, undefined);
      each(this.figures, this.socket.hash);
    }
  }
}

const flight = (x: number, z: number, steps: number, speed = 12_000): Camera[] =>
  Array.from({ length: steps }, (_, k) => ({ x: x + k * speed, z: z - k * 3 * speed, y: 2600, yaw: -0.3 + 0.02 * k, pitch: -0.2, verticalFov: 1.0472, width: 640, height: 360 }));

for (const terrain of ['alpine', 'canyon'])
  test(`every iteration of a flight over ${terrain} has the hash that the server says`, async (t) => {
    const server = await Server.start(['--terrain', terrain, '--seed', '1']);
    t.after(() => server.stop());
    const client = new Client(server), { copy } = client;
    let looked = 0, checked = 0;
    const check = ({ hashOk, iteration, triangles }: Figures, hash: bigint): void => {
      assert.ok(hashOk, `iteration ${iteration}`);
      if (++looked % 8 !== 0) return;
      ++checked;
      assert.equal(copy.hash, hash, `iteration ${iteration} on the screen`);
      assert.equal(copy.triangles, triangles);
    };
    client.begin();
    await client.fly(flight(358_400, 921_600, STEPS), check);
    const times = client.times.sort((a, b) => a - b), { decoded, triangles, mismatches } = client.figures!;
    t.diagnostic(`${decoded} triangles came in ${times.length} iterations; one took ${times[times.length >> 1]!.toFixed(1)} ms, one of a hundred ${times[Math.floor(0.99 * times.length)]!.toFixed(1)}; ${JSON.stringify(forms)}`);
    assert.equal(mismatches, 0);
    assert.ok(triangles > 10_000 && checked > STEPS / 10);
    assert.ok(forms.points > 10_000 && forms.come > 100 && forms.gone > 100, JSON.stringify(forms));

    await t.test('resumes on a new connection', async () => {
      client.end();
      client.begin();
      await client.fly(flight(358_400 + (STEPS - 1) * 12_000, 921_600 - (STEPS - 1) * 36_000, 3, 0), check);
      const again = client.figures!.decoded - decoded;
      assert.ok(again < triangles * 3 / 2, `${again} came for ${triangles}`);  // all of them, once
      assert.equal(copy.hash, client.socket.hash);
    });
    client.end();
    await t.test('far away', async () => {
      const far = new Client(server);
      far.begin();
      await far.fly(flight(2 ** 50 - 2 ** 30, -(2 ** 49), 6), ({ hashOk }) => assert.ok(hashOk));
      assert.equal(far.copy.hash, far.socket.hash);
      far.end();
    });
    await t.test('damaged points are noticed and mended', async () => {
      const mended = new Client(server, true);
      let agreed = 0;
      mended.begin();
      await mended.fly(flight(358_400, 921_600, 41), ({ hashOk }, hash) => {
        if (hashOk) ++agreed, assert.equal(mended.copy.hash, hash);
      });
      const { mismatches } = mended.figures!, { damages } = mended.socket;
      assert.ok(damages >= 5 && mismatches >= damages / 2 && agreed >= 8, `${damages} damaged, ${mismatches} mended, ${agreed} agree`);
      assert.ok(forms.draco > 0 && forms.plain > 10, JSON.stringify(forms));
      mended.end();
    });
  });

// FLIGHTS=200 STEPS=100: more of them, and longer ones; FLIGHTS=3 STEPS=36000: an hour over each terrain.
test('random flights have the hashes that the server says', async (t) => {
  const flights = Number(process.env.FLIGHTS ?? 3), steps = Number(process.env.STEPS ?? 30);
  const random = randomFrom(1);
  const terrains = ['alpine', 'canyon', 'archipelago'];
  const servers = await Promise.all(terrains.map((terrain) => Server.start(['--terrain', terrain, '--seed', '5'])));
  t.after(() => Promise.all(servers.map((server) => server.stop())));
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
    const client = new Client(servers[n % 3]!);
    client.begin();
    await client.fly(cameras, ({ hashOk, iteration }) => assert.ok(hashOk, `iteration ${iteration}`));
    assert.equal(client.copy.hash, client.socket.hash);
    t.diagnostic(`${terrains[n % 3]} at ${start}: ${client.figures!.decoded} triangles came, ${client.figures!.triangles} are held`);
    client.end();
  }
});
