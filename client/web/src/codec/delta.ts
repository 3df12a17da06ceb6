// A delta's payload and a base -> the leaf it makes. PROTOCOL.md, Delta payload; the names are the page's.

import { Difference, GOES, STAYS, UNDECIDED, assemble } from './assemble';
import { Sum, hashTriangle, hashVertex, out } from './hash';
import { LeafMesh, MAX_HEIGHT, MAX_OFFSET, MAX_TRIANGLES, Refusal, cornerX, cornerZ, orientation } from './mesh';
import { Contexts, RangeDecoder } from './range_decoder';
import { Reader } from './reader';
import { bytes, signed, words } from './scratch';

const FORM = 0x20;
const NOBODY = 0xffffffff;
const MAX_WALK = 32;

// Where each set of contexts begins.
const LENGTH = 0, TOP = 33, NUMBER = 66; // of a number: 33 for its length, 33 for its second bit
const GAP = 0, STEPS = GAP + NUMBER, PLACE = STEPS + NUMBER, HEIGHT = PLACE + NUMBER;
const GROWS = HEIGHT + NUMBER;
const IS_BEFORE = GROWS + 4, IS_BEHIND = IS_BEFORE + 12, IS_FRESH = IS_BEHIND + 12, IS_NONE = IS_FRESH + 6;
const IS_WALK = IS_NONE + 3, IS_FORWARDS = IS_WALK + 1, SEED_IS_FRESH = IS_FORWARDS + 1;
const FINER = SEED_IS_FRESH + 1, FINER_HEIGHT = FINER + 11, CONTEXTS = FINER_HEIGHT + 11;

export interface DeltaHead {
  removed: number;
  added: number;
  fresh: number;
  check: number; // low half of the new leaf's hash
  body: Uint8Array;
}

/** The announced counts, checked against the payload's length and the base: what decoding allocates is bounded by them. */
export function readHead(payload: Uint8Array, baseTriangles: number): DeltaHead {
  const reader = new Reader(payload);
  if (reader.byte() !== FORM) throw new Refusal('the form of its delta is unknown');
  const removed = reader.varint(), added = reader.varint(), fresh = reader.varint();
  const check = reader.word();
  const body = reader.rest();
  if (removed > baseTriangles) throw new Refusal('more triangles go than the leaf has');
  if (baseTriangles - removed + added > MAX_TRIANGLES) throw new Refusal('it would have too many triangles');
  if (fresh > 3 * added || added > 64 * (body.length + 1)) throw new Refusal("its delta's counts contradict each other");
  return { removed, added, fresh, check, body };
}

class Walk implements Difference {
  readonly triangleCount: number;
  readonly fates: Uint8Array;
  readonly added: Uint32Array;
  readonly vertices: Int32Array;
  vertexCount: number;
  private addedCount = 0;
  private effort: number;
  private readonly level: number;
  private readonly gone: Uint32Array;
  private goneCount = 0;
  // The triangles of each vertex: around[start[v] .. start[v + 1]).
  private readonly start: Uint32Array;
  private readonly around: Uint32Array;
  // Open edges, those with the same begin and those with the same end chained, newest first.
  private edgeCount = 0;
  private readonly edgeA: Uint32Array;
  private readonly edgeB: Uint32Array;
  private readonly edgeThird: Uint32Array;
  private readonly edgeKind: Uint8Array;
  private readonly edgeOpen: Uint8Array;
  private readonly nextOut: Uint32Array;
  private readonly previousOut: Uint32Array;
  private readonly nextIn: Uint32Array;
  private readonly previousIn: Uint32Array;
  private readonly out: Uint32Array; // by vertex: its newest open edge onwards
  private readonly into: Uint32Array; // and back
  private readonly filled: Uint32Array; // by vertex: newest edge of kind 1 onwards that a triangle closed

  constructor(
    private readonly coder: RangeDecoder,
    private readonly base: LeafMesh,
    private readonly head: DeltaHead,
  ) {
    const triangles = base.triangles.length / 3;
    this.triangleCount = triangles;
    this.level = base.address.level;
    this.effort = 256 * (triangles + head.added) + 65536;
    this.vertexCount = base.vertices.length / 3;
    const most = this.vertexCount + head.fresh;
    this.vertices = signed(0, 3 * most);
    this.vertices.set(base.vertices);
    this.added = new Uint32Array(3 * head.added);
    this.fates = bytes(0, triangles).fill(UNDECIDED, 0, triangles);
    this.gone = new Uint32Array(head.removed);
    const corners = base.triangles, start = words(1, this.vertexCount + 2).fill(0, 0, this.vertexCount + 2), around = words(2, corners.length);
    // A counting sort; start[v] ends one place too far to the right until all are placed.
    for (let k = 0; k < corners.length; ++k) ++start[corners[k]! + 2]!;
    for (let v = 0; v < this.vertexCount; ++v) start[v + 2]! += start[v + 1]!;
    for (let t = 0, k = 0; k < corners.length; ++t)
      for (const end = k + 3; k < end; ++k) around[start[corners[k]! + 1]!++] = t;
    this.start = start;
    this.around = around;
    // Each triangle that goes opens at most three edges, each that comes two more, a seed three.
    const edges = 3 * (head.removed + head.added);
    this.edgeA = words(3, edges);
    this.edgeB = words(4, edges);
    this.edgeThird = words(5, edges);
    this.edgeKind = bytes(1, edges);
    this.edgeOpen = bytes(2, edges);
    this.nextOut = words(6, edges);
    this.previousOut = words(7, edges);
    this.nextIn = words(8, edges);
    this.previousIn = words(9, edges);
    this.out = words(10, most).fill(NOBODY, 0, most);
    this.into = words(11, most).fill(NOBODY, 0, most);
    this.filled = words(12, most).fill(NOBODY, 0, most);
  }

  run(): void {
    this.remove();
    this.openHoles();
    this.fill();
    if (this.freshLeft > 0 || !this.coder.finished) throw new Refusal('its delta does not have the length that its content needs');
  }

  private get freshLeft(): number {
    return this.base.vertices.length / 3 + this.head.fresh - this.vertexCount;
  }

  private spend(n = 1): void {
    this.effort -= n;
    if (this.effort < 0 || this.coder.failed) throw new Refusal('its delta does not fit the leaf that is held');
  }

  // ---- numbers ----

  private number(set: number): number {
    let n = 0;
    while (n < 31 && this.coder.bit(set + LENGTH + n)) ++n;
    let v = 1;
    for (let k = 0; k < n; ++k) v = v * 2 + ((k === 0 ? this.coder.bit(set + TOP + n) : this.coder.even()) ? 1 : 0);
    return v - 1;
  }
  private below(n: number): number {
    let v = 0;
    for (let k = 32 - Math.clz32(n - 1); k > 0; --k) v = v * 2 + (this.coder.even() ? 1 : 0);
    if (v >= n) throw new Refusal('its delta names a vertex that is not there');
    return v;
  }
  private difference(set: number, fine: number): number {
    let v = this.number(set);
    for (let k = 0; k < fine; ++k) v = v * 2 + (this.coder.even() ? 1 : 0);
    return v !== 0 && this.coder.even() ? -v : v;
  }

  // ---- triangles that go ----

  /** The triangle of the base across the k-th edge of t, or NOBODY. */
  private across(t: number, k: number): number {
    const tri = this.base.triangles;
    const a = tri[3 * t + k]!, b = tri[3 * t + (k + 1) % 3]!;
    for (let n = this.start[b]!; n < this.start[b + 1]!; ++n) {
      this.spend();
      const s = this.around[n]!, p = tri[3 * s]!, q = tri[3 * s + 1]!, r = tri[3 * s + 2]!;
      if ((p === b && q === a) || (q === b && r === a) || (r === b && p === a)) return s;
    }
    return NOBODY;
  }

  private remove(): void {
    const { fates, gone } = this;
    let cursor = 0;
    while (this.goneCount < gone.length) {
      let gap = this.number(GAP);
      for (; cursor < this.triangleCount; ++cursor) {
        if (fates[cursor] !== UNDECIDED) continue;
        if (gap === 0) break;
        --gap;
        fates[cursor] = STAYS;
      }
      if (cursor >= this.triangleCount) throw new Refusal('its delta does not fit the leaf that is held');
      const first = this.goneCount;
      fates[cursor] = GOES;
      gone[this.goneCount++] = cursor;
      for (let q = first; q < this.goneCount && this.goneCount < gone.length; ++q)
        for (let k = 0; k < 3 && this.goneCount < gone.length; ++k) {
          const s = this.across(gone[q]!, k);
          if (s === NOBODY || fates[s] !== UNDECIDED) continue;
          const goes = this.coder.bit(GROWS + Math.min(q - first, 3));
          fates[s] = goes ? GOES : STAYS;
          if (goes) gone[this.goneCount++] = s;
        }
    }
  }

  // ---- open edges ----

  private openEdge(a: number, b: number, third: number, kind: number): void {
    const e = this.edgeCount++;
    this.edgeA[e] = a;
    this.edgeB[e] = b;
    this.edgeThird[e] = third;
    this.edgeKind[e] = kind;
    this.edgeOpen[e] = 1;
    this.previousOut[e] = this.previousIn[e] = NOBODY;
    const o = (this.nextOut[e] = this.out[a]!);
    if (o !== NOBODY) this.previousOut[o] = e;
    this.out[a] = e;
    const i = (this.nextIn[e] = this.into[b]!);
    if (i !== NOBODY) this.previousIn[i] = e;
    this.into[b] = e;
  }

  private closeEdge(e: number, byTriangle: boolean): void {
    this.edgeOpen[e] = 0;
    const a = this.edgeA[e]!, b = this.edgeB[e]!;
    const po = this.previousOut[e]!, no = this.nextOut[e]!, pi = this.previousIn[e]!, ni = this.nextIn[e]!;
    if (po === NOBODY) this.out[a] = no;
    else this.nextOut[po] = no;
    if (no !== NOBODY) this.previousOut[no] = po;
    if (pi === NOBODY) this.into[b] = ni;
    else this.nextIn[pi] = ni;
    if (ni !== NOBODY) this.previousIn[ni] = pi;
    if (!byTriangle || this.edgeKind[e] !== 1) return;
    this.nextOut[e] = this.filled[a]!;
    this.filled[a] = e;
  }

  private find(first: Uint32Array, a: number, b: number): number {
    let e = first[a]!;
    while (e !== NOBODY && this.edgeB[e] !== b) {
      this.spend();
      e = this.nextOut[e]!;
    }
    return e;
  }

  private openHoles(): void {
    const tri = this.base.triangles;
    for (const t of this.gone)
      for (let k = 0; k < 3; ++k) {
        const s = this.across(t, k);
        if (s !== NOBODY && this.fates[s] === GOES) continue;
        this.openEdge(tri[3 * t + k]!, tri[3 * t + (k + 1) % 3]!, tri[3 * t + (k + 2) % 3]!, s === NOBODY ? 1 : 0);
      }
  }

  // ---- triangles that come ----

  private fill(): void {
    let cursor = 0, current = NOBODY;
    while (this.addedCount < this.head.added) {
      this.spend(4);
      if (current === NOBODY) {
        while (cursor < this.edgeCount && !this.edgeOpen[cursor]) ++cursor;
        if (cursor === this.edgeCount) {
          this.seed();
          continue;
        }
        current = cursor;
      }
      const a = this.edgeA[current]!, b = this.edgeB[current]!;
      const apex = this.apex(current);
      this.closeEdge(current, apex !== NOBODY);
      if (apex !== NOBODY) {
        this.come(a, b, apex);
        this.pass(b, apex, a);
        this.pass(apex, a, b);
      }
      current = this.out[b]!;
      if (current === NOBODY && apex !== NOBODY) current = this.out[apex]!;
    }
  }

  private come(a: number, b: number, c: number): void {
    if (orientation(this.vertices, a, b, c) <= 0) throw new Refusal('its delta makes a triangle that is not counter-clockwise');
    const at = 3 * this.addedCount++;
    this.added[at] = a;
    this.added[at + 1] = b;
    this.added[at + 2] = c;
  }

  private pass(p: number, q: number, r: number): void {
    const e = this.find(this.out, p, q);
    if (e !== NOBODY) this.closeEdge(e, true);
    else if (this.find(this.out, q, p) === NOBODY && this.find(this.filled, q, p) === NOBODY) this.openEdge(q, p, r, 2);
  }

  /** The vertex so many open edges onwards from one, or back; NOBODY beyond an end. */
  private along(v: number, forwards: boolean, steps: number): number {
    for (; steps > 0 && v !== NOBODY; --steps) {
      const e = forwards ? this.out[v]! : this.into[v]!;
      v = e === NOBODY ? NOBODY : forwards ? this.edgeB[e]! : this.edgeA[e]!;
    }
    return v;
  }

  private isInside(a: number, b: number, c: number, d: number): boolean {
    const v = this.vertices;
    const dx = v[3 * d]!, dz = v[3 * d + 1]!;
    const ax = v[3 * a]! - dx, az = v[3 * a + 1]! - dz, bx = v[3 * b]! - dx, bz = v[3 * b + 1]! - dz, cx = v[3 * c]! - dx, cz = v[3 * c + 1]! - dz;
    return (ax * ax + az * az) * (bz * cx - bx * cz) + (bx * bx + bz * bz) * (cz * ax - cx * az) + (cx * cx + cz * cz) * (az * bx - ax * bz) > 0;
  }

  private apex(edge: number): number {
    const a = this.edgeA[edge]!, b = this.edgeB[edge]!, kind = this.edgeKind[edge]!;
    let before = this.along(a, false, 1), behind = this.along(b, true, 1);
    if (before !== NOBODY && orientation(this.vertices, a, b, before) <= 0) before = NOBODY;
    if (behind !== NOBODY && orientation(this.vertices, a, b, behind) <= 0) behind = NOBODY;
    let situation = 0;
    if (before !== NOBODY && behind !== NOBODY) situation = before === behind ? 1 : this.isInside(a, b, before, behind) ? 3 : 2;
    if (before !== NOBODY && this.coder.bit(IS_BEFORE + 4 * kind + situation)) return before;
    if (behind !== NOBODY && behind !== before && this.coder.bit(IS_BEHIND + 4 * kind + situation)) return behind;
    if (this.freshLeft > 0 && this.coder.bit(IS_FRESH + 2 * kind + (before !== NOBODY || behind !== NOBODY ? 1 : 0)))
      return this.fresh(a, b, this.edgeThird[edge]!, kind);
    if (this.coder.bit(IS_NONE + kind)) return NOBODY;
    if (!this.coder.bit(IS_WALK)) return this.any();
    const forwards = this.coder.bit(IS_FORWARDS);
    const steps = this.number(STEPS) + 1;
    const v = steps > MAX_WALK ? NOBODY : this.along(forwards ? b : a, forwards, steps);
    if (v === NOBODY) throw new Refusal('its delta walks over an end');
    return v;
  }

  private any(): number {
    if (this.vertexCount === 0) throw new Refusal('its delta names a vertex that is not there');
    return this.below(this.vertexCount);
  }

  private seed(): void {
    const v = [0, 0, 0];
    for (let k = 0; k < 3; ++k) {
      const from = k === 0 ? NOBODY : v[k - 1]!;
      v[k] = this.freshLeft > 0 && this.coder.bit(SEED_IS_FRESH) ? this.fresh(from, from, from, 2) : this.any();
    }
    const [a, b, c] = v as [number, number, number];
    this.come(a, b, c);
    this.pass(a, b, c);
    this.pass(b, c, a);
    this.pass(c, a, b);
  }

  // ---- new vertices ----

  private finer(set: number): number {
    let l = this.level;
    while (l > 0 && this.coder.bit(set + this.level - l)) --l;
    return l;
  }

  /** A new vertex of the edge (a, b) with third c, which are one in a seed, or nobody. */
  private fresh(a: number, b: number, c: number, kind: number): number {
    const v = this.vertices;
    const middle = 2 ** (12 + this.level);
    const none = a === NOBODY;
    const ax = none ? middle : v[3 * a]!, az = none ? middle : v[3 * a + 1]!, ay = none ? 0 : v[3 * a + 2]!;
    const bx = none ? middle : v[3 * b]!, bz = none ? middle : v[3 * b + 1]!, by = none ? 0 : v[3 * b + 2]!;
    const cx = none ? middle : v[3 * c]!, cz = none ? middle : v[3 * c + 1]!, cy = none ? 0 : v[3 * c + 2]!;
    const mirrored = kind === 2 && a !== b;
    const guess = (p: number, q: number, r: number): number => Math.floor((mirrored ? 2 * p + 2 * q - r : p + q + r) / 3);

    let l = this.finer(FINER);
    const h = l === 0 ? 0 : l + 4;
    const fine = Math.max(0, 29 - Math.clz32(Math.max(Math.abs(bx - ax), Math.abs(bz - az)) >> h));
    const x = ((guess(ax, bx, cx) >> h) + this.difference(PLACE, fine)) * 2 ** h;
    const z = ((guess(az, bz, cz) >> h) + this.difference(PLACE, fine)) * 2 ** h;
    if (Math.abs(x) > MAX_OFFSET || Math.abs(z) > MAX_OFFSET) throw new Refusal('a vertex is out of range');

    l = this.finer(FINER_HEIGHT);
    const s = l === 0 ? 0 : l + 3;
    const ux = bx - ax, uz = bz - az, wx = cx - ax, wz = cz - az, px = x - ax, pz = z - az, d = ux * wz - uz * wx;
    const least = Math.min(ay, by, cy), most = Math.max(ay, by, cy);
    let plane = (least + most) >> 1;
    if (d !== 0) {
      const at = ay + ((px * wz - pz * wx) / d) * (by - ay) + ((ux * pz - uz * px) / d) * (cy - ay);
      plane = Math.floor(Math.min(Math.max(at, 2 * least - most), 2 * most - least));
    }
    const y = ((plane >> s) + this.difference(HEIGHT, 0)) * 2 ** s;
    if (Math.abs(y) > MAX_HEIGHT) throw new Refusal('a vertex is out of range');
    const number = this.vertexCount++;
    v[3 * number] = x;
    v[3 * number + 1] = z;
    v[3 * number + 2] = y;
    return number;
  }
}

export interface Changed {
  leaf: LeafMesh;
  hash: bigint;
}

/** Throws Refusal where the leaf that was meant does not come out. `baseHash` is hashLeaf(base). */
export function decodeDelta(payload: Uint8Array, base: LeafMesh, baseHash: bigint): Changed {
  if (payload.length === 0) return { leaf: base, hash: baseHash };
  const head = readHead(payload, base.triangles.length / 3);
  const walk = new Walk(new RangeDecoder(head.body, new Contexts(CONTEXTS)), base, head);
  walk.run();
  const leaf = assemble(base, walk);

  // The hash follows the difference: only what goes and what comes is hashed.
  const sum = Sum.of(baseHash);
  const hashes = signed(14, 2 * walk.vertexCount), known = bytes(4, walk.vertexCount).fill(0, 0, walk.vertexCount);
  const x0 = cornerX(base.address), z0 = cornerZ(base.address), v = walk.vertices;
  const hash = (k: number): void => {
    if (known[k]) return;
    known[k] = 1;
    hashVertex(x0 + v[3 * k]!, z0 + v[3 * k + 1]!, v[3 * k + 2]!);
    hashes[2 * k] = out[0]!;
    hashes[2 * k + 1] = out[1]!;
  };
  const hashOf = (a: number, b: number, c: number): void => {
    hash(a), hash(b), hash(c);
    const less = (p: number, q: number): boolean => (v[3 * p]! - v[3 * q]! || v[3 * p + 1]! - v[3 * q + 1]!) < 0;
    if (less(b, a) && less(b, c)) hashTriangle(hashes, b, c, a);
    else if (less(c, a) && less(c, b)) hashTriangle(hashes, c, a, b);
    else hashTriangle(hashes, a, b, c);
  };
  const t = base.triangles;
  for (let k = 0; k < walk.triangleCount; ++k) {
    if (walk.fates[k] !== GOES) continue;
    hashOf(t[3 * k]!, t[3 * k + 1]!, t[3 * k + 2]!);
    sum.subtract(out[0]!, out[1]!);
  }
  for (let k = 0; k < walk.added.length; k += 3) {
    hashOf(walk.added[k]!, walk.added[k + 1]!, walk.added[k + 2]!);
    sum.add(out[0]!, out[1]!);
  }
  if (sum.lo >>> 0 !== head.check) throw new Refusal('its delta makes another leaf than the one that was meant');
  return { leaf, hash: sum.value };
}
