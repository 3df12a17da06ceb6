// A leaf's mesh and its canonical order. PROTOCOL.md: Leaves, Canonical order.

export const MAX_LEVEL = 10;
export const MAX_OFFSET = 1 << 27; // steps from the leaf's corner, x and z
export const MAX_HEIGHT = 1 << 25; // steps
export const MAX_TRIANGLES = 1 << 20; // of a leaf

export interface LeafAddress {
  readonly level: number;
  readonly i: number; // whole, |i| <= 2^37
  readonly j: number;
}

/** In any order. */
export interface LeafMesh {
  readonly address: LeafAddress;
  readonly vertices: Int32Array; // x, z, y of each, steps, x and z from the corner
  readonly triangles: Uint32Array; // three indices each, counter-clockwise from above
}

/** What a server sent that cannot be; the sentence is for a person. */
export class Refusal extends Error {}

export const sideOf = (a: LeafAddress): number => 2 ** (13 + a.level);
export const cornerX = (a: LeafAddress): number => a.i * sideOf(a);
export const cornerZ = (a: LeafAddress): number => a.j * sideOf(a);
export const keyOf = (a: LeafAddress): string => `${a.level}/${a.i}/${a.j}`;
export const nameOf = (a: LeafAddress): string => `leaf (level ${a.level}, ${a.i}, ${a.j})`;

export function addressIsValid(a: LeafAddress): boolean {
  const limit = 2 ** 50 / sideOf(a);
  return a.level >= 0 && a.level <= MAX_LEVEL && Math.abs(a.i) <= limit && Math.abs(a.j) <= limit;
}

/** Twice the area of (a, b, c), vertices of `v`, or, where doubles would round, something of the same sign. Positive: counter-clockwise. */
export function orientation(v: Int32Array, a: number, b: number, c: number): number {
  const ax = v[3 * a]!, az = v[3 * a + 1]!;
  const bx = v[3 * b]! - ax, bz = v[3 * b + 1]! - az, cx = v[3 * c]! - ax, cz = v[3 * c + 1]! - az;
  const area = bz * cx - bx * cz;
  // Each product is rounded by less than 2^5 (they stay below 2^57).
  if (area > 64 || area < -64) return area;
  return Number(BigInt(bz) * BigInt(cx) - BigInt(bx) * BigInt(cz));
}

/** Writes a triangle at `at` of `to`, rotated so that its smallest index comes first. */
function putRotated(to: Uint32Array, at: number, a: number, b: number, c: number): void {
  if (b < a && b < c) {
    to[at] = b, to[at + 1] = c, to[at + 2] = a;
  } else if (c < a && c < b) {
    to[at] = c, to[at + 1] = a, to[at + 2] = b;
  } else {
    to[at] = a, to[at + 1] = b, to[at + 2] = c;
  }
}

/** Triangles ascending by first, second, third index, all below `count`: two counting sorts; the second index settles it in a mesh. */
function sortedTriangles(triangles: Uint32Array, count: number): Uint32Array {
  let from = triangles;
  for (const corner of [2, 1, 0]) {
    const start = new Uint32Array(count + 1);
    for (let k = corner; k < from.length; k += 3) ++start[from[k]! + 1]!;
    for (let v = 0; v < count; ++v) start[v + 1]! += start[v]!;
    const to = new Uint32Array(from.length);
    for (let k = 0; k < from.length; k += 3) {
      const at = 3 * start[from[k + corner]!]!++;
      to[at] = from[k]!, to[at + 1] = from[k + 1]!, to[at + 2] = from[k + 2]!;
    }
    from = to;
  }
  return from;
}

/** Triangles over points in any order -> canonical order. Indices must be in range. Throws Refusal: two vertices share x and z, two
 *  triangles are the same, or one is not counter-clockwise. */
export function canonical(address: LeafAddress, points: Int32Array, triangles: Uint32Array): LeafMesh {
  const count = points.length / 3;
  const used = new Uint8Array(count);
  for (const v of triangles) used[v] = 1;
  const order = new Uint32Array(count);
  let n = 0;
  for (let v = 0; v < count; ++v) if (used[v]) order[n++] = v;
  const sorted = order.subarray(0, n);
  sorted.sort((a, b) => points[3 * a]! - points[3 * b]! || points[3 * a + 1]! - points[3 * b + 1]! || points[3 * a + 2]! - points[3 * b + 2]!);
  const place = new Uint32Array(count);
  const vertices = new Int32Array(3 * n);
  let last = -1;
  for (const v of sorted) {
    const x = points[3 * v]!, z = points[3 * v + 1]!, y = points[3 * v + 2]!;
    if (last < 0 || vertices[3 * last] !== x || vertices[3 * last + 1] !== z) {
      ++last;
      vertices[3 * last] = x, vertices[3 * last + 1] = z, vertices[3 * last + 2] = y;
    } else if (vertices[3 * last + 2] !== y) {
      throw new Refusal('two vertices share a place');
    }
    place[v] = last;
  }
  const rotated = new Uint32Array(triangles.length);
  for (let k = 0; k < triangles.length; k += 3)
    putRotated(rotated, k, place[triangles[k]!]!, place[triangles[k + 1]!]!, place[triangles[k + 2]!]!);
  const leaf = { address, vertices: vertices.slice(0, 3 * (last + 1)), triangles: sortedTriangles(rotated, last + 1) };
  checkTriangles(leaf);
  return leaf;
}

/** Throws unless all triangles are counter-clockwise and none is there twice. */
function checkTriangles(leaf: LeafMesh): void {
  const t = leaf.triangles;
  for (let k = 0; k < t.length; k += 3) {
    if (orientation(leaf.vertices, t[k]!, t[k + 1]!, t[k + 2]!) <= 0) throw new Refusal('a triangle is not counter-clockwise');
    if (k > 0 && t[k] === t[k - 3] && t[k + 1] === t[k - 2] && t[k + 2] === t[k - 1]) throw new Refusal('two triangles are the same');
  }
}
