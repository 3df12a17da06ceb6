// The client's half of the stream, twin of server/replica: iterations change what is held, its hash is compared with the server's, what
// differs is asked for again, what was taken is acknowledged, and a later connection resumes. No sockets: a Stream carries what is said.

import type { DracoDecode } from '../codec/leaf';
import { Refusal } from '../codec/mesh';
import type { Iteration, World } from '../generated/ridgecast/v1/stream_pb';
import { Change, Scene } from '../scene/scene';
import type { Held, Stream } from '../stream/stream';

/** Where answers go. */
type Answers = Pick<Stream, 'acknowledge' | 'resend'>;

export interface Applied extends Change {
  readonly agrees: boolean; // with the server's hash
  /** To be called once, when the change was taken up; does nothing after the connection that the iteration came over. */
  readonly acknowledge: () => void;
}

export class Replica {
  readonly scene: Scene;
  readonly totals = { decoded: 0, hashes: 0, mismatches: 0 }; // triangles that came; iterations compared, and those that differed unexpectedly
  private contentHash: bigint | undefined;
  private connection: { answers: Answers } | undefined;

  constructor(draco: DracoDecode) {
    this.scene = new Scene(draco);
  }

  /** A connection has begun. Returns what is held of its world, for the server to compare; nothing when it is another world. */
  resume(world: World, answers: Answers): Held[] {
    if (this.contentHash !== world.contentHash) this.scene.clear();
    this.contentHash = world.contentHash;
    this.scene.reconnect();
    this.connection = { answers };
    return [...this.scene.leaves.values()].map(({ mesh, hash }) => ({ address: mesh.address, hash }));
  }

  /** Applies all of it and asks again for what is not the server's. A Refusal that is thrown ends the connection; then nothing is held. */
  apply(iteration: Iteration): Applied {
    const { scene, connection } = this, { answers } = connection!;
    let change: Change;
    try {
      change = scene.apply(iteration);
    } catch (error) {
      if (error instanceof Refusal) scene.clear();
      throw error;
    }
    const { hash } = scene, agrees = hash === iteration.meshHash;
    this.totals.decoded += change.decoded;
    ++this.totals.hashes;
    if (scene.damaged) {
      const damaged = scene.takeDamaged();
      if (damaged.length > 0) answers.resend(damaged);
    } else if (!agrees) {
      ++this.totals.mismatches;
      answers.resend([]);
    }
    const acknowledge = (): void => {
      if (connection === this.connection) answers.acknowledge(iteration.number, hash);
    };
    return { ...change, agrees, acknowledge };
  }
}
