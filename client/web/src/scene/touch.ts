// Where a ray meets the mesh that is held, and what lies around there on it.

import { cornerX, cornerZ } from '../codec/mesh';
import type { Brush, Place, Touched } from '../messages';
import { STEPS_PER_METRE, Vec3 } from '../render/view';
import type { HeldLeaf } from './draft';
import type { Scene } from './scene';

const AROUND = 96; // places of an outline
const APART = 4; // metres between those of a line
const MOST_OF_PIECE = 256; // of them, in a piece of a line

export function touch(scene: Scene, brush: Brush): Touched | undefined {
  const at = hit(scene, brush);
  if (!at) return undefined;
  const lay = (x: number, z: number): Place => ({ x, z, y: scene.height(x, z) ?? at.y }), radius = brush.radius * STEPS_PER_METRE;
  const outline = Array.from({ length: AROUND }, (_, k) => {
    const angle = (2 * Math.PI * k) / AROUND;
    return lay(at.x + radius * Math.cos(angle), at.z + radius * Math.sin(angle));
  });
  const line = brush.line.flatMap((from, k) => {
    const to = brush.line[k + 1] ?? at, dx = to.x - from.x, dz = to.z - from.z;
    const pieces = Math.min(MOST_OF_PIECE, Math.ceil(Math.hypot(dx, dz) / STEPS_PER_METRE / APART));
    return Array.from({ length: pieces }, (_, p) => lay(from.x + (dx * p) / pieces, from.z + (dz * p) / pieces));
  });
  return { at, outline, line: line.length > 0 ? [...line, at] : [] };
}

/** On whole steps. */
function hit({ leaves }: Scene, { from, towards }: Brush): Place | undefined {
  const [dx, dy, dz] = towards, ahead: { leaf: HeldLeaf; begins: number; origin: Vec3 }[] = [];
  for (const leaf of leaves.values()) {
    const { address } = leaf; // x, z, y of the eye from its corner, steps
    const origin: Vec3 = [from.x - cornerX(address) + from.remainderX, from.z - cornerZ(address) + from.remainderZ, from.y * STEPS_PER_METRE];
    const begins = entry(leaf, origin, [dx, dz, dy]);
    if (begins !== undefined) ahead.push({ leaf, begins, origin });
  }
  ahead.sort((a, b) => a.begins - b.begins);
  let nearest = Infinity;
  for (const { leaf, begins, origin } of ahead) {
    if (begins > nearest) break;
    nearest = Math.min(nearest, meets(leaf, origin, [dx, dz, dy]));
  }
  if (nearest === Infinity) return undefined;
  const along = (whole: number, remainder: number, by: number): number => whole + Math.round(remainder + by * nearest);
  return { x: along(from.x, from.remainderX, dx), z: along(from.z, from.remainderZ, dz), y: from.y + (dy * nearest) / STEPS_PER_METRE };
}

/** How far along the ray a leaf's box begins, 0 inside; nothing: it does not meet it. */
function entry({ triangles, low, high }: HeldLeaf, origin: Vec3, towards: Vec3): number | undefined {
  if (triangles === 0) return undefined;
  let begins = 0, ends = Infinity;
  for (let c = 0; c < 3; ++c) {
    const by = towards[c]!, a = low[c]! - origin[c]!, b = high[c]! - origin[c]!;
    if (by === 0 && (a > 0 || b < 0)) return undefined;
    if (by === 0) continue;
    begins = Math.max(begins, Math.min(a / by, b / by));
    ends = Math.min(ends, Math.max(a / by, b / by));
  }
  return begins <= ends ? begins : undefined;
}

/** How far along the ray it meets a leaf's triangles first (Moeller and Trumbore 1997). */
function meets({ mesh: { vertices: v, triangles: t } }: HeldLeaf, [ox, oz, oy]: Vec3, [dx, dz, dy]: Vec3): number {
  let nearest = Infinity;
  for (let k = 0; k < t.length; k += 3) {
    const a = 3 * t[k]!, b = 3 * t[k + 1]!, c = 3 * t[k + 2]!;
    const ax = v[a]!, az = v[a + 1]!, ay = v[a + 2]!;
    const bx = v[b]! - ax, bz = v[b + 1]! - az, by = v[b + 2]! - ay, cx = v[c]! - ax, cz = v[c + 1]! - az, cy = v[c + 2]! - ay;
    const px = dz * cy - dy * cz, pz = dy * cx - dx * cy, py = dx * cz - dz * cx, volume = bx * px + bz * pz + by * py;
    if (volume === 0) continue;
    const sx = ox - ax, sz = oz - az, sy = oy - ay, u = (sx * px + sz * pz + sy * py) / volume;
    if (u < 0 || u > 1) continue;
    const qx = sz * by - sy * bz, qz = sy * bx - sx * by, qy = sx * bz - sz * bx, w = (dx * qx + dz * qz + dy * qy) / volume;
    if (w < 0 || u + w > 1) continue;
    const along = (cx * qx + cz * qz + cy * qy) / volume;
    if (along > 0 && along < nearest) nearest = along;
  }
  return nearest;
}
