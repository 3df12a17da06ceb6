// The client's half of the stream, twin of server/replica: iterations change what is held, its hash is compared with the server's, where
// they differ everything is asked for again, what was taken is acknowledged, and a later connection resumes. No sockets: a Stream carries
// what is said.

import type { DracoDecode } from '../codec/leaf';
import { Refusal } from '../codec/mesh';
import type { Iteration, World } from '../generated/ridgecast/v1/stream_pb';
import { PointMesh } from '../scene/point_mesh';
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
  readonly totals = { decoded: 0, hashes: 0, mismatches: 0 }; // triangles, as in Change; iterations compared, and those after which leaves were asked for again
  private contentHash: bigint | undefined;
  private connection: { answers: Answers } | undefined;

  private asked = false; // for all leaves, and they have not come yet

  constructor(draco: DracoDecode, points: WebAssembly.Module) {
    this.scene = new Scene(draco, new PointMesh(points));
  }

  /** A connection has begun. Returns what is held of its world, for the server to compare; nothing when it is another world. */
  resume(world: World, answers: Answers): Held[] {
    if (this.contentHash !== world.contentHash) this.scene.clear();
    this.contentHash = world.contentHash;
    this.scene.reconnect();
    this.connection = { answers };
    this.asked = false;
    return [...this.scene.leaves.values()].map(({ address, hash }) => ({ address, hash }));
  }

  /** Applies all of it; asks for everything again, once, where that is not what the server holds. A Refusal that is thrown ends the connection; then nothing is held. */
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
    if (!agrees && !this.asked) {
      ++this.totals.mismatches;
      answers.resend();
    }
    this.asked = !agrees;
    const acknowledge = (): void => {
      if (connection === this.connection) answers.acknowledge(iteration.number, hash);
    };
    return { ...change, agrees, acknowledge };
  }
}
