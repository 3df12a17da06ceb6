// The mesh that is held: leaves by address, replaced all or nothing by iterations. No sockets, no pictures.

import type { Iteration, LeafAddress as WireAddress } from '../generated/ridgecast/v1/stream_pb';
import { decodeDelta, readHead } from '../codec/delta';
import { DracoDecode, decodeLeaf } from '../codec/leaf';
import { LeafAddress, LeafMesh, MAX_LEVEL, Refusal, addressIsValid, cornerX, cornerZ, gather, hashLeaf, hashTerm, keyOf, nameOf, parentOf } from '../codec/mesh';

// Most that is held, whatever a server sends.
export const MAX_TRIANGLES = 8_000_000;
export const MAX_LEAVES = 65_536;
const MAX_GATHERED = 32_000_000;
const MASK = (1n << 64n) - 1n;

export interface HeldLeaf {
  readonly mesh: LeafMesh;
  readonly hash: bigint;
  readonly low: readonly [number, number, number]; // least x, z, y of its vertices; 0 when empty
  readonly high: readonly [number, number, number];
}

/** What an iteration did to the leaves held, for whoever draws them. */
export interface Change {
  readonly gone: readonly LeafAddress[];
  readonly fresh: readonly HeldLeaf[]; // new, or in the place of what was held
  readonly decoded: number; // triangles that came, in deltas and whole
}

function hold(mesh: LeafMesh, hash: bigint): HeldLeaf {
  const low: [number, number, number] = [0, 0, 0], high: [number, number, number] = [0, 0, 0];
  for (let c = 0; c < 3 && mesh.vertices.length > 0; ++c) {
    let least = mesh.vertices[c]!, most = least;
    for (let k = c + 3; k < mesh.vertices.length; k += 3) {
      const v = mesh.vertices[k]!;
      if (v < least) least = v;
      if (v > most) most = v;
    }
    low[c] = least, high[c] = most;
  }
  return { mesh, hash, low, high };
}

function addressOf(wire: WireAddress | undefined): LeafAddress {
  const address = { level: wire?.level ?? 0, i: Number(wire?.i ?? 0n), j: Number(wire?.j ?? 0n) };
  if (!addressIsValid(address)) throw new Refusal(`${nameOf(address)} lies beyond the lattice`);
  return address;
}

export class Scene {
  readonly leaves = new Map<string, HeldLeaf>();
  hash = 0n;
  triangles = 0;
  private last = 0n; // number of the last iteration, 0 before any
  private damagedKeys = new Set<string>();
  private untold: LeafAddress[] = [];

  constructor(private readonly draco: DracoDecode) {}

  /** Either everything in it is applied, or a Refusal is thrown and nothing is. A delta that does not make the leaf that was meant is
   *  forgiven: its base stays, and takeDamaged() names it. */
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
    this.damagedKeys.clear();
    this.untold = [];
    this.hash = 0n;
    this.triangles = 0;
    this.last = 0n;
  }

  /** The connection was lost and what is held stays: the next iteration is the first of another one. */
  reconnect(): void {
    this.last = 0n;
  }

  get damaged(): boolean {
    return this.damagedKeys.size > 0;
  }
  /** Leaves that are not what the server thinks, each told once; to be named to it before the hash is. */
  takeDamaged(): LeafAddress[] {
    const out = this.untold;
    this.untold = [];
    return out;
  }

  /** Height in metres of the mesh at a point given in steps; nothing where no triangle lies. */
  height(x: number, z: number): number | undefined {
    for (const { mesh, low, high } of this.leaves.values()) {
      const lx = x - cornerX(mesh.address), lz = z - cornerZ(mesh.address);
      if (lx < low[0] || lx > high[0] || lz < low[1] || lz > high[1]) continue;
      const v = mesh.vertices, t = mesh.triangles;
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
    let hash = this.hash, triangles = this.triangles, count = this.leaves.size;
    const subtract = (leaf: HeldLeaf): void => {
      hash -= hashTerm(leaf.mesh.address, leaf.hash);
      triangles -= leaf.mesh.triangles.length / 3;
      --count;
    };

    const gone = new Map<string, LeafAddress>();
    const below = new Map<string, HeldLeaf[]>(); // by ancestor: the leaves in `gone` that lie in it
    for (const wire of iteration.gone) {
      const address = addressOf(wire), key = keyOf(address), held = this.leaves.get(key);
      if (!held) throw new Refusal(`${nameOf(address)} is gone but was not held`);
      if (gone.has(key)) throw new Refusal(`${nameOf(address)} is gone twice`);
      gone.set(key, address);
      subtract(held);
      for (let up = address; up.level < MAX_LEVEL; ) {
        up = parentOf(up);
        const list = below.get(keyOf(up));
        if (list) list.push(held);
        else below.set(keyOf(up), [held]);
      }
    }
    const family = (address: LeafAddress): HeldLeaf[] => {
      const out = [...(below.get(keyOf(address)) ?? [])];
      for (let up = address; up.level < MAX_LEVEL; ) {
        up = parentOf(up);
        if (gone.has(keyOf(up))) out.push(this.leaves.get(keyOf(up))!);
      }
      return out;
    };

    const fresh = new Map<string, HeldLeaf | undefined>();
    const replaced = (address: LeafAddress): HeldLeaf | undefined => {
      const key = keyOf(address);
      if (fresh.has(key)) throw new Refusal(`${nameOf(address)} is there twice`);
      fresh.set(key, undefined);
      const held = gone.has(key) ? undefined : this.leaves.get(key);
      if (held) subtract(held);
      return held;
    };
    let announced = 0, decoded = 0, searched = 0;
    const wholes = iteration.whole.map((whole) => {
      const address = addressOf(whole.address);
      replaced(address);
      announced += whole.triangles;
      return address;
    });
    const bases = iteration.changed.map((delta) => {
      const address = addressOf(delta.address);
      let base = replaced(address);
      if (!base) {
        const sources = family(address).map((leaf) => leaf.mesh);
        for (const source of sources) searched += source.triangles.length / 3;
        if (searched > MAX_GATHERED) throw new Refusal('too much would have to be gathered from leaves that are gone');
        const mesh = gather(address, sources);
        base = { mesh, hash: hashLeaf(mesh), low: [0, 0, 0], high: [0, 0, 0] };
      }
      announced += base.mesh.triangles.length / 3;
      if (delta.payload.length > 0) {
        try {
          const head = readHead(delta.payload, base.mesh.triangles.length / 3);
          announced += head.added - head.removed;
          decoded += head.added;
        } catch {
          // It fails again below, where that is forgiven.
        }
      }
      return base;
    });
    if (triangles + announced > MAX_TRIANGLES) throw new Refusal(`the mesh would have ${triangles + announced} triangles, at most ${MAX_TRIANGLES} are held`);
    if (count + fresh.size > MAX_LEAVES) throw new Refusal(`the mesh would have ${count + fresh.size} leaves, at most ${MAX_LEAVES} are held`);

    const keep = (address: LeafAddress, mesh: LeafMesh, leafHash: bigint): void => {
      hash += hashTerm(address, leafHash);
      triangles += mesh.triangles.length / 3;
      fresh.set(keyOf(address), hold(mesh, leafHash));
    };
    iteration.whole.forEach((whole, k) => {
      try {
        const mesh = decodeLeaf(whole.payload, wholes[k]!, whole.vertices, whole.triangles, this.draco);
        decoded += whole.triangles;
        keep(wholes[k]!, mesh, hashLeaf(mesh));
      } catch (error) {
        throw error instanceof Refusal ? new Refusal(`${nameOf(wholes[k]!)}: ${error.message}`) : error;
      }
    });
    const damaged = new Set<string>();
    iteration.changed.forEach((delta, k) => {
      const base = bases[k]!;
      let changed: { leaf: LeafMesh; hash: bigint } = { leaf: base.mesh, hash: base.hash };
      try {
        changed = decodeDelta(delta.payload, base.mesh, base.hash);
      } catch (error) {
        if (!(error instanceof Refusal)) throw error;
        damaged.add(keyOf(base.mesh.address));
      }
      keep(base.mesh.address, changed.leaf, changed.hash);
    });

    for (const key of gone.keys()) this.leaves.delete(key);
    const came: HeldLeaf[] = [];
    for (const [key, leaf] of fresh) {
      this.leaves.set(key, leaf!);
      came.push(leaf!);
      if (!damaged.has(key)) this.damagedKeys.delete(key);
      else if (!this.damagedKeys.has(key)) this.damagedKeys.add(key), this.untold.push(leaf!.mesh.address);
    }
    for (const key of this.damagedKeys) if (!this.leaves.has(key)) this.damagedKeys.delete(key);
    this.hash = hash & MASK;
    this.triangles = triangles;
    this.last = iteration.number;
    return { gone: [...gone.values()], fresh: came, decoded };
  }
}
