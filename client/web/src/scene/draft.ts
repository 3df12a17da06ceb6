// What an iteration makes of the leaves that are held, on the side: everything in it that can fail is tried here.

import { DracoDecode, decodeLeaf } from '../codec/leaf';
import { LeafAddress, LeafMesh, Refusal, addressIsValid, keyOf, nameOf } from '../codec/mesh';
import type { Iteration, LeafWhole, LeafAddress as WireAddress } from '../generated/ridgecast/v1/stream_pb';
import { ChangedLeaf, Corner, PointMesh } from './point_mesh';

// Most that is held, whatever a server sends.
const MAX_TRIANGLES = 8_000_000;
const MAX_LEAVES = 65_536;

/** A leaf that points made has its triangles when somebody reads them, and only until it is replaced. */
export class HeldLeaf {
  private constructor(
    readonly address: LeafAddress,
    readonly hash: bigint,
    readonly triangles: number, // how many there are
    readonly low: Corner, // hold its vertices; 0 when empty
    readonly high: Corner,
    private made: LeafMesh | PointMesh,
  ) {}

  static changed({ address, hash, triangles, low, high }: ChangedLeaf, points: PointMesh): HeldLeaf {
    return new HeldLeaf(address, hash, triangles, low, high, points);
  }

  static of(mesh: LeafMesh, hash: bigint): HeldLeaf {
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
    return new HeldLeaf(mesh.address, hash, mesh.triangles.length / 3, low, high, mesh);
  }

  static empty(address: LeafAddress): HeldLeaf {
    return HeldLeaf.of({ address, vertices: new Int32Array(0), triangles: new Uint32Array(0) }, 0n);
  }

  get isMade(): boolean {
    return !(this.made instanceof PointMesh);
  }

  get mesh(): LeafMesh {
    if (this.made instanceof PointMesh) this.made = this.made.extract(this.address);
    return this.made;
  }
}

function addressOf(wire: WireAddress | undefined): LeafAddress {
  const address = { level: wire?.level ?? 0, i: Number(wire?.i ?? 0n), j: Number(wire?.j ?? 0n) };
  if (!addressIsValid(address)) throw new Refusal(`${nameOf(address)} lies beyond the lattice`);
  return address;
}

/** What is held; a Draft leaves it as it is. */
export interface Before {
  readonly leaves: ReadonlyMap<string, HeldLeaf>;
  readonly hash: bigint;
  readonly triangles: number;
  readonly lost: boolean;
}

export class Draft {
  readonly gone = new Map<string, LeafAddress>();
  readonly fresh = new Map<string, HeldLeaf>(); // new, or in the place of what was held
  hash: bigint; // of what the leaves become, as the next two
  triangles: number;
  lost: boolean;
  changed: ChangedLeaf[] = []; // that points may have changed; none where they were lost
  decoded = 0; // triangles of leaves that came, and those by which others grew
  private readonly named = new Set<string>(); // keys that come or are whole
  private count: number; // of leaves

  constructor(
    private readonly before: Before,
    private readonly points: PointMesh,
  ) {
    this.hash = before.hash;
    this.triangles = before.triangles;
    this.lost = before.lost;
    this.count = before.leaves.size;
  }

  /** Throws Refusal. */
  fill(iteration: Iteration, draco: DracoDecode): void {
    for (const wire of iteration.gone) this.remove(addressOf(wire));
    let announced = this.triangles;
    const wholes = iteration.whole.map((leaf) => {
      const address = addressOf(leaf.address), held = this.claim(address);
      announced += leaf.triangles - (held?.triangles ?? 0);
      return address;
    });
    const come = iteration.come.map((wire) => {
      const address = addressOf(wire);
      if (this.claim(address)) throw new Refusal(`${nameOf(address)} comes but was held`);
      return address;
    });
    this.judge(announced);
    if (this.count > MAX_LEAVES) throw new Refusal(`the mesh would have ${this.count} leaves, at most ${MAX_LEAVES} are held`);
    iteration.whole.forEach((leaf, k) => this.decode(leaf, wholes[k]!, draco));
    const isAnew = iteration.number === 1n || wholes.length > 0;
    if (isAnew) this.lost = !this.points.begin(this.heldOrWhole());
    this.follow(isAnew ? [] : [...this.gone.values()], come, iteration.points);
  }

  private subtract({ address, hash, triangles }: HeldLeaf): void {
    this.hash -= this.points.hashTerm(address, hash);
    this.triangles -= triangles;
  }
  private keep(leaf: HeldLeaf, had = 0): void {
    this.hash += this.points.hashTerm(leaf.address, leaf.hash);
    this.triangles += leaf.triangles;
    this.decoded += Math.max(0, leaf.triangles - had);
    this.fresh.set(keyOf(leaf.address), leaf);
  }
  /** The leaf that is held and stays. */
  private held(key: string): HeldLeaf | undefined {
    return this.gone.has(key) ? undefined : this.before.leaves.get(key);
  }

  private remove(address: LeafAddress): void {
    const key = keyOf(address), held = this.before.leaves.get(key);
    if (!held && this.lost) return;
    if (!held) throw new Refusal(`${nameOf(address)} is gone but was not held`);
    if (this.gone.has(key)) throw new Refusal(`${nameOf(address)} is gone twice`);
    this.gone.set(key, address);
    this.subtract(held);
    --this.count;
  }

  /** The leaf that is held in the place of one that is to be there. */
  private claim(address: LeafAddress): HeldLeaf | undefined {
    const key = keyOf(address), held = this.held(key);
    if (this.named.has(key)) throw new Refusal(`${nameOf(address)} is there twice`);
    this.named.add(key);
    if (!held) ++this.count;
    return held;
  }

  private decode({ payload, vertices, triangles }: LeafWhole, address: LeafAddress, draco: DracoDecode): void {
    try {
      const mesh = decodeLeaf(payload, address, vertices, triangles, draco), held = this.held(keyOf(address));
      if (held) this.subtract(held);
      this.keep(HeldLeaf.of(mesh, this.points.hashLeaf(mesh)));
    } catch (error) {
      throw error instanceof Refusal ? new Refusal(`${nameOf(address)}: ${error.message}`) : error;
    }
  }

  /** The leaves that the points begin with, before others come. */
  private *heldOrWhole(): Generator<LeafMesh> {
    for (const [key, leaf] of this.before.leaves) if (!this.gone.has(key) && !this.fresh.has(key)) yield leaf.mesh;
    for (const { mesh } of this.fresh.values()) yield mesh;
  }

  private judge(triangles: number): void {
    if (triangles > MAX_TRIANGLES) throw new Refusal(`the mesh would have ${triangles} triangles, at most ${MAX_TRIANGLES} are held`);
  }

  // Points that do not fit leave the mesh as it is, to be requested again.
  private follow(gone: LeafAddress[], come: LeafAddress[], payload: Uint8Array): void {
    for (const address of come) this.keep(HeldLeaf.empty(address));
    this.lost ||= !this.points.follow(gone, come, payload);
    if (this.lost) return this.lose();
    this.changed = this.points.takeChanged();
    for (const changed of this.changed) {
      const key = keyOf(changed.address), before = this.fresh.get(key) ?? this.held(key);
      if (!before || before.hash === changed.hash) continue;
      this.subtract(before);
      this.keep(HeldLeaf.changed(changed, this.points), before.triangles);
    }
    this.judge(this.triangles);
  }

  // What was not made of points that were followed before cannot be made any more.
  private lose(): void {
    for (const [key, leaf] of this.before.leaves)
      if (!leaf.isMade && !this.gone.has(key) && !this.fresh.has(key)) {
        this.subtract(leaf);
        this.keep(HeldLeaf.empty(leaf.address));
      }
  }
}
