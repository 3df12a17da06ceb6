// The mesh that is held: leaves by address, replaced all or nothing by iterations. No sockets, no pictures.

import type { DracoDecode } from '../codec/leaf';
import { LeafAddress, Refusal, cornerX, cornerZ } from '../codec/mesh';
import type { Iteration } from '../generated/ridgecast/v1/stream_pb';
import { Draft, HeldLeaf } from './draft';
import type { ChangedLeaf, Drawing, PointMesh } from './point_mesh';

/** What an iteration did to the leaves held, for whoever draws them. */
export interface Change {
  readonly gone: readonly LeafAddress[];
  readonly fresh: readonly HeldLeaf[]; // new, or in the place of what was held
  readonly drawn: readonly ChangedLeaf[]; // to be drawn anew; where points were lost, what is drawn stays
  readonly drawing: Drawing; // of those
  readonly decoded: number; // triangles of leaves that came, and those by which others grew
}

export class Scene {
  readonly leaves = new Map<string, HeldLeaf>();
  hash = 0n;
  triangles = 0;
  lost = false; // points came that do not fit those held: the leaves that they make stay as they are until all come whole
  private last = 0n; // number of the last iteration, 0 before any

  constructor(
    private readonly draco: DracoDecode,
    private readonly points: PointMesh,
  ) {}

  /** Either everything in it is applied, or a Refusal is thrown and nothing is; then clear() must follow. */
  apply(iteration: Iteration): Change {
    const name = `iteration ${iteration.number}: `;
    try {
      return this.applied(iteration);
    } catch (error) {
      throw error instanceof Refusal ? new Refusal(name + error.message) : error;
    }
  }

  clear(): void {
    this.leaves.clear();
    this.hash = 0n;
    this.triangles = 0;
    this.last = 0n;
    this.lost = true;
  }

  /** The connection was lost and what is held stays: the next iteration is the first of another one. */
  reconnect(): void {
    this.last = 0n;
  }

  /** Height in metres of the mesh at a point given in steps; nothing where no triangle lies. */
  height(x: number, z: number): number | undefined {
    for (const leaf of this.leaves.values()) {
      const { address, low, high } = leaf, lx = x - cornerX(address), lz = z - cornerZ(address);
      if (lx < low[0] || lx > high[0] || lz < low[1] || lz > high[1]) continue;
      const { vertices: v, triangles: t } = leaf.mesh;
      const side = (a: number, b: number): number => (v[3 * b + 1]! - v[3 * a + 1]!) * (lx - v[3 * a]!) - (v[3 * b]! - v[3 * a]!) * (lz - v[3 * a + 1]!);
      for (let k = 0; k < t.length; k += 3) {
        const a = t[k]!, b = t[k + 1]!, c = t[k + 2]!;
        const wa = side(b, c), wb = side(c, a), wc = side(a, b);
        if (wa >= 0 && wb >= 0 && wc >= 0) return (wa * v[3 * a + 2]! + wb * v[3 * b + 2]! + wc * v[3 * c + 2]!) / (wa + wb + wc) / 256;
      }
    }
    return undefined;
  }

  // First everything that can fail, on the side; then what cannot.
  private applied(iteration: Iteration): Change {
    if (iteration.number === 0n || (this.last !== 0n && iteration.number !== this.last + 1n)) throw new Refusal(`out of order, ${this.last + 1n} was expected`);
    const draft = new Draft(this, this.points);
    draft.fill(iteration, this.draco);
    const { gone, fresh, decoded, changed: drawn } = draft, drawing = this.points.draw(drawn.length);
    for (const key of gone.keys()) this.leaves.delete(key);
    for (const [key, leaf] of fresh) this.leaves.set(key, leaf);
    this.hash = BigInt.asUintN(64, draft.hash);
    this.triangles = draft.triangles;
    this.lost = draft.lost;
    this.last = iteration.number;
    return { gone: [...gone.values()], fresh: [...fresh.values()], drawn, drawing, decoded };
  }
}
