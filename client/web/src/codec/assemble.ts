// A leaf and how it differs -> the leaf that it becomes.

import { LeafMesh, Refusal, putRotated, sortedTriangles } from './mesh';
import { bytes, words } from './scratch';

export const UNDECIDED = 0, STAYS = 1, GOES = 2;

export interface Difference {
  readonly triangleCount: number; // of the base
  readonly fates: Uint8Array; // of the base's triangles
  readonly added: Uint32Array; // triangles that came
  readonly vertices: Int32Array; // the base's, then those that came
  readonly vertexCount: number;
}

/** What stays and what came, in canonical order: both are merged, since what stays is in order already. */
export function assemble(base: LeafMesh, difference: Difference): LeafMesh {
  const { vertices, fates, added, triangleCount } = difference, corners = base.triangles;
  const old = base.vertices.length / 3, count = difference.vertexCount;
  const used = bytes(3, count).fill(0, 0, count);
  let kept = 0;
  for (let t = 0; t < triangleCount; ++t) {
    if (fates[t] === GOES) continue;
    ++kept;
    used[corners[3 * t]!] = used[corners[3 * t + 1]!] = used[corners[3 * t + 2]!] = 1;
  }
  for (const v of added) used[v] = 1;
  const fresh = new Uint32Array(count - old);
  for (let v = old; v < count; ++v) {
    if (!used[v]) throw new Refusal('a new vertex has no triangle');
    fresh[v - old] = v;
  }
  const compare = (a: number, b: number): number => vertices[3 * a]! - vertices[3 * b]! || vertices[3 * a + 1]! - vertices[3 * b + 1]!;
  fresh.sort(compare);

  // Old and new vertices; next: the new one that is waited with, as far behind as it belongs.
  const place = words(13, count);
  let total = fresh.length;
  for (let v = 0; v < old; ++v) total += used[v]!;
  const to = new Int32Array(3 * total);
  let n = 0, next = 0;
  for (let v = 0; v <= old; ++v) {
    if (v < old && !used[v]) continue;
    while (next < fresh.length && (v === old || compare(fresh[next]!, v) < 0)) {
      const f = fresh[next++]!;
      place[f] = n / 3;
      to[n++] = vertices[3 * f]!, to[n++] = vertices[3 * f + 1]!, to[n++] = vertices[3 * f + 2]!;
    }
    if (v === old) break;
    place[v] = n / 3;
    to[n++] = vertices[3 * v]!, to[n++] = vertices[3 * v + 1]!, to[n++] = vertices[3 * v + 2]!;
  }
  for (let k = 3; k < n; k += 3) if (to[k] === to[k - 3] && to[k + 1] === to[k - 2]) throw new Refusal('two vertices share a place');

  const came = new Uint32Array(added.length);
  for (let k = 0; k < added.length; k += 3) putRotated(came, k, place[added[k]!]!, place[added[k + 1]!]!, place[added[k + 2]!]!);
  const comes = cameInOrder(came, total);
  const triangles = new Uint32Array(3 * kept + added.length);
  let at = 0, c = 0;
  for (let t = 0, k = 0; t < triangleCount; ++t, k += 3) {
    if (fates[t] === GOES) continue;
    const p = place[corners[k]!]!, q = place[corners[k + 1]!]!, r = place[corners[k + 2]!]!;
    while (c < comes.length && (comes[c]! - p || comes[c + 1]! - q || comes[c + 2]! - r) < 0) {
      triangles[at++] = comes[c++]!, triangles[at++] = comes[c++]!, triangles[at++] = comes[c++]!;
    }
    triangles[at++] = p, triangles[at++] = q, triangles[at++] = r;
  }
  while (c < comes.length) triangles[at++] = comes[c++]!;
  return { address: base.address, vertices: to, triangles };
}

// A few triangles do not deserve counting sorts over all vertices.
function cameInOrder(came: Uint32Array, vertices: number): Uint32Array {
  const count = came.length / 3;
  if (count > vertices / 4) return sortedTriangles(came, vertices);
  const order = new Uint32Array(count);
  for (let k = 0; k < count; ++k) order[k] = 3 * k;
  order.sort((a, b) => came[a]! - came[b]! || came[a + 1]! - came[b + 1]! || came[a + 2]! - came[b + 2]!);
  const sorted = new Uint32Array(came.length);
  for (let k = 0; k < count; ++k) sorted.set(came.subarray(order[k]!, order[k]! + 3), 3 * k);
  return sorted;
}
