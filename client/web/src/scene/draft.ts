// What an iteration makes of the leaves that are held, on the side: everything in it that can fail is tried here.

import { decodeDelta, readHead } from '../codec/delta';
import { DracoDecode, decodeLeaf } from '../codec/leaf';
import { LeafAddress, LeafMesh, MAX_LEVEL, Refusal, addressIsValid, gather, hashLeaf, hashTerm, keyOf, nameOf, parentOf } from '../codec/mesh';
import type { Iteration, LeafDelta, LeafWhole, LeafAddress as WireAddress } from '../generated/ridgecast/v1/stream_pb';

// Most that is held, whatever a server sends.
const MAX_TRIANGLES = 8_000_000;
const MAX_LEAVES = 65_536;
const MAX_GATHERED = 32_000_000;

export interface HeldLeaf {
  readonly mesh: LeafMesh;
  readonly hash: bigint;
  readonly low: readonly [number, number, number]; // least x, z, y of its vertices; 0 when empty
  readonly high: readonly [number, number, number];
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

interface Base {
  mesh: LeafMesh;
  hash: bigint;
}

export class Draft {
  readonly gone = new Map<string, LeafAddress>();
  readonly fresh = new Map<string, HeldLeaf>(); // new, or in the place of what was held
  readonly damaged = new Set<string>(); // of `fresh`: a delta did not make the leaf that was meant, so the base stays
  decoded = 0; // triangles that came
  private count: number; // of leaves
  private readonly below = new Map<string, HeldLeaf[]>(); // by ancestor: the leaves in `gone` that lie in it
  private readonly named = new Set<string>(); // keys that are whole or changed
  private announced = 0; // triangles
  private searched = 0;

  /** `hash` and `triangles` are those of `leaves`, which stay as they are; afterwards those of what they become. */
  constructor(
    private readonly leaves: ReadonlyMap<string, HeldLeaf>,
    public hash: bigint,
    public triangles: number,
  ) {
    this.count = leaves.size;
  }

  /** Throws Refusal. */
  fill({ gone, whole, changed }: Iteration, draco: DracoDecode): void {
    for (const wire of gone) this.remove(addressOf(wire));
    const wholes = whole.map((leaf) => {
      const address = addressOf(leaf.address);
      this.replaced(address);
      this.announced += leaf.triangles;
      return address;
    });
    const bases = changed.map((delta) => this.baseOf(delta));
    const triangles = this.triangles + this.announced, leaves = this.count + this.named.size;
    if (triangles > MAX_TRIANGLES) throw new Refusal(`the mesh would have ${triangles} triangles, at most ${MAX_TRIANGLES} are held`);
    if (leaves > MAX_LEAVES) throw new Refusal(`the mesh would have ${leaves} leaves, at most ${MAX_LEAVES} are held`);
    whole.forEach((leaf, k) => this.decodeWhole(leaf, wholes[k]!, draco));
    changed.forEach((delta, k) => this.decodeChanged(delta, bases[k]!));
  }

  private subtract({ mesh, hash }: HeldLeaf): void {
    this.hash -= hashTerm(mesh.address, hash);
    this.triangles -= mesh.triangles.length / 3;
    --this.count;
  }

  private keep(mesh: LeafMesh, hash: bigint): void {
    this.hash += hashTerm(mesh.address, hash);
    this.triangles += mesh.triangles.length / 3;
    this.fresh.set(keyOf(mesh.address), hold(mesh, hash));
  }

  private remove(address: LeafAddress): void {
    const key = keyOf(address), held = this.leaves.get(key);
    if (!held) throw new Refusal(`${nameOf(address)} is gone but was not held`);
    if (this.gone.has(key)) throw new Refusal(`${nameOf(address)} is gone twice`);
    this.gone.set(key, address);
    this.subtract(held);
    for (let up = address; up.level < MAX_LEVEL; ) {
      up = parentOf(up);
      const list = this.below.get(keyOf(up));
      if (list) list.push(held);
      else this.below.set(keyOf(up), [held]);
    }
  }

  /** The leaf that is held there and makes room for another. */
  private replaced(address: LeafAddress): HeldLeaf | undefined {
    const key = keyOf(address);
    if (this.named.has(key)) throw new Refusal(`${nameOf(address)} is there twice`);
    this.named.add(key);
    const held = this.gone.has(key) ? undefined : this.leaves.get(key);
    if (held) this.subtract(held);
    return held;
  }

  /** What is gone below a leaf or above it. */
  private family(address: LeafAddress): LeafMesh[] {
    const out = [...(this.below.get(keyOf(address)) ?? [])];
    for (let up = address; up.level < MAX_LEVEL; ) {
      up = parentOf(up);
      if (this.gone.has(keyOf(up))) out.push(this.leaves.get(keyOf(up))!);
    }
    return out.map((leaf) => leaf.mesh);
  }

  private baseOf({ address: wire, payload }: LeafDelta): Base {
    const address = addressOf(wire);
    let base: Base | undefined = this.replaced(address);
    if (!base) {
      const sources = this.family(address);
      for (const source of sources) this.searched += source.triangles.length / 3;
      if (this.searched > MAX_GATHERED) throw new Refusal('too much would have to be gathered from leaves that are gone');
      const mesh = gather(address, sources);
      base = { mesh, hash: hashLeaf(mesh) };
    }
    const triangles = base.mesh.triangles.length / 3;
    this.announced += triangles;
    if (payload.length === 0) return base;
    try {
      const { added, removed } = readHead(payload, triangles);
      this.announced += added - removed;
      this.decoded += added;
    } catch {
      // It fails again when it is decoded, where that is forgiven.
    }
    return base;
  }

  private decodeWhole({ payload, vertices, triangles }: LeafWhole, address: LeafAddress, draco: DracoDecode): void {
    try {
      const mesh = decodeLeaf(payload, address, vertices, triangles, draco);
      this.decoded += triangles;
      this.keep(mesh, hashLeaf(mesh));
    } catch (error) {
      throw error instanceof Refusal ? new Refusal(`${nameOf(address)}: ${error.message}`) : error;
    }
  }

  private decodeChanged({ payload }: LeafDelta, { mesh, hash }: Base): void {
    let changed = { leaf: mesh, hash };
    try {
      changed = decodeDelta(payload, mesh, hash);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.damaged.add(keyOf(mesh.address));
    }
    this.keep(changed.leaf, changed.hash);
  }
}
