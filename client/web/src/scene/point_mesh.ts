// The triangulation that follows points: the C++ client's own, as WebAssembly (wasm/point_mesh.cpp). Also hashes leaves. Not for shades.

import { LeafAddress, LeafMesh, Refusal } from '../codec/mesh';

interface Functions {
  memory: WebAssembly.Memory;
  _initialize(): void;
  room(bytes: number): number;
  hashLeaf(level: number, i: bigint, j: bigint, vertices: number, triangles: number): bigint;
  hashTerm(level: number, i: bigint, j: bigint, leafHash: bigint): bigint;
  hold(level: number, i: bigint, j: bigint, vertices: number): void;
  begin(): number;
  follow(gone: number, come: number, bytes: number): number;
  takeChanged(): number;
  changed(): number;
  extract(level: number, i: bigint, j: bigint): number;
  draw(): number;
}

const ADDRESS = 24, CHANGED = 64; // bytes of LeafAddress and PointMesh::Changed: level, i and j in eight each; then hash, triangles, low and high
const whole = (hash: bigint): bigint => BigInt.asUintN(64, hash);

export type Corner = readonly [x: number, z: number, y: number]; // steps from the leaf's corner

export interface ChangedLeaf {
  readonly address: LeafAddress;
  readonly hash: bigint;
  readonly triangles: number; // how many there are
  readonly low: Corner; // hold its vertices, which may span less
  readonly high: Corner;
}

/** Of the leaves that takeChanged() told of last, for a copy of the slots that their triangles lie in, BLOCK to a block (PointMesh::draw). */
export interface Drawing {
  readonly ends: Uint32Array; // of each leaf, where its blocks end in `blocks`
  readonly blocks: Uint32Array; // the numbers of all its blocks now
  readonly changed: Uint32Array; // slots in these that are not as they were told last, block by block
  readonly corners: Int32Array; // of those, x, z, y of three corners, steps from their leaf's corner; 0 where there is no triangle
}
export const BLOCK = 16, SLOT = 9; // slots of a block, numbers of a slot

/** Where memory ends, its functions throw a Refusal, and nothing is held. */
export class PointMesh {
  private wasm: Functions;

  constructor(private readonly module: WebAssembly.Module) {
    this.wasm = this.instance();
  }

  hashLeaf({ address, vertices, triangles }: LeafMesh): bigint {
    return this.guarded(() => {
      const { level, i, j } = this.put(address, vertices, triangles);
      return whole(this.wasm.hashLeaf(level, i, j, vertices.length / 3, triangles.length / 3));
    });
  }

  /** One leaf's term of the mesh's hash, which is the sum of these. */
  hashTerm({ level, i, j }: LeafAddress, leafHash: bigint): bigint {
    return whole(this.wasm.hashTerm(level, BigInt(i), BigInt(j), leafHash));
  }

  /** The points are the corners of these leaves' triangles. False: they contradict each other, and nothing is held. */
  begin(leaves: Iterable<LeafMesh>): boolean {
    return this.guarded(() => {
      for (const { address, vertices } of leaves) {
        const { level, i, j } = this.put(address, vertices);
        this.wasm.hold(level, i, j, vertices.length / 3);
      }
      return this.wasm.begin() !== 0;
    });
  }

  /** False: the points do not fit those that are held; only begin() helps then. */
  follow(gone: readonly LeafAddress[], come: readonly LeafAddress[], payload: Uint8Array): boolean {
    return this.guarded(() => {
      const addresses = [...gone, ...come], to = this.room(ADDRESS * addresses.length + payload.length);
      const view = new DataView(to.buffer, to.byteOffset);
      addresses.forEach(({ level, i, j }, k) => {
        view.setInt32(ADDRESS * k, level, true);
        view.setBigInt64(ADDRESS * k + 8, BigInt(i), true);
        view.setBigInt64(ADDRESS * k + 16, BigInt(j), true);
      });
      to.set(payload, ADDRESS * addresses.length);
      return this.wasm.follow(gone.length, come.length, payload.length) !== 0;
    });
  }

  /** The leaves whose triangles may have changed since the last call. */
  takeChanged(): ChangedLeaf[] {
    return this.guarded(() => {
      const count = this.wasm.takeChanged(), view = new DataView(this.wasm.memory.buffer, this.wasm.changed());
      return Array.from({ length: count }, (_, k) => {
        const at = CHANGED * k;
        const address = { level: view.getInt32(at, true), i: Number(view.getBigInt64(at + 8, true)), j: Number(view.getBigInt64(at + 16, true)) };
        const corner = (k: number): Corner => [view.getInt32(k, true), view.getInt32(k + 4, true), view.getInt32(k + 8, true)];
        return { address, hash: view.getBigUint64(at + 24, true), triangles: view.getUint32(at + 32, true), low: corner(at + 36), high: corner(at + 48) };
      });
    });
  }

  /** A leaf that points made, as it is now. */
  extract({ level, i, j }: LeafAddress): LeafMesh {
    return this.guarded(() => {
      const at = this.wasm.extract(level, BigInt(i), BigInt(j)), { buffer } = this.wasm.memory;
      const [vertices, vertexCount, triangles, triangleCount] = new Uint32Array(buffer, at, 4) as unknown as [number, number, number, number];
      return { address: { level, i, j }, vertices: new Int32Array(buffer, vertices, 3 * vertexCount).slice(), triangles: new Uint32Array(buffer, triangles, 3 * triangleCount).slice() };
    });
  }

  /** `leaves`: as many as takeChanged() told of last, or none. */
  draw(leaves: number): Drawing {
    if (leaves === 0) return { ends: new Uint32Array(0), blocks: new Uint32Array(0), changed: new Uint32Array(0), corners: new Int32Array(0) };
    return this.guarded(() => {
      const at = this.wasm.draw(), { buffer } = this.wasm.memory;
      const [ends, blocks, changed, corners, blockCount, changedCount] = new Uint32Array(buffer, at, 6) as unknown as [number, number, number, number, number, number];
      return {
        ends: new Uint32Array(buffer, ends, leaves).slice(),
        blocks: new Uint32Array(buffer, blocks, blockCount).slice(),
        changed: new Uint32Array(buffer, changed, changedCount).slice(),
        corners: new Int32Array(buffer, corners, SLOT * changedCount).slice(),
      };
    });
  }

  private put({ level, i, j }: LeafAddress, ...arrays: (Int32Array | Uint32Array)[]): { level: number; i: bigint; j: bigint } {
    const to = this.room(arrays.reduce((sum, { byteLength }) => sum + byteLength, 0));
    let at = 0;
    for (const { buffer, byteOffset, byteLength } of arrays) {
      to.set(new Uint8Array(buffer, byteOffset, byteLength), at);
      at += byteLength;
    }
    return { level, i: BigInt(i), j: BigInt(j) };
  }

  private room(bytes: number): Uint8Array {
    const at = this.wasm.room(bytes);
    return new Uint8Array(this.wasm.memory.buffer, at, bytes);
  }

  private instance(): Functions {
    const functions = new WebAssembly.Instance(this.module).exports as unknown as Functions;
    functions._initialize();
    return functions;
  }

  private guarded<T>(work: () => T): T {
    try {
      return work();
    } catch (error) {
      if (!(error instanceof WebAssembly.RuntimeError)) throw error;
      this.wasm = this.instance();
      throw new Refusal('the mesh does not fit into memory');
    }
  }
}
