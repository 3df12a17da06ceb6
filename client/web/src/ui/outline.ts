// Places on the ground as a line over the picture.

import type { Place } from '../messages';
import { STEPS_PER_METRE, View, forwardOf, rightOf, tangentsOf, upOf, type Vec3 } from '../render/view';

const NEAREST = 0.1; // metres before the camera: what is nearer is cut off

export type Frame = Pick<View, 'pose' | 'width' | 'height' | 'verticalFov'>; // in CSS pixels

/** From the camera through a place of the window. */
export function towards({ pose, ...window }: Frame, x: number, y: number): Vec3 {
  const f = forwardOf(pose), r = rightOf(pose), u = upOf(pose), [tx, ty] = tangentsOf(window);
  const right = tx * ((2 * x) / window.width - 1), up = ty * (1 - (2 * y) / window.height);
  return f.map((v, c) => v + right * r[c]! + up * u[c]!) as Vec3;
}

/** An SVG path through these places; closed: back to the first. What lies behind the camera is left out. */
export function pathOf(places: readonly Place[], { pose, width, height, verticalFov }: Frame, closed: boolean): string {
  const f = forwardOf(pose), r = rightOf(pose), u = upOf(pose), [tx, ty] = tangentsOf({ width, height, verticalFov });
  const seen = places.map(({ x, z, y }): Vec3 => {
    const d = [(x - pose.x - pose.remainderX) / STEPS_PER_METRE, y - pose.y, (z - pose.z - pose.remainderZ) / STEPS_PER_METRE];
    const dot = (v: Vec3): number => v[0] * d[0]! + v[1] * d[1]! + v[2] * d[2]!;
    return [dot(r), dot(u), dot(f)];
  });
  if (closed && seen.length > 0) seen.push(seen[0]!);
  const shown = ([x, y, depth]: Vec3): string => `${((x / depth / tx + 1) * 0.5 * width).toFixed(1)} ${((1 - y / depth / ty) * 0.5 * height).toFixed(1)}`;
  const cut = (a: Vec3, b: Vec3): Vec3 => a.map((v, c) => v + ((b[c]! - v) * (NEAREST - a[2])) / (b[2] - a[2])) as Vec3;
  let path = '', pen = false; // whether it stands where the next piece begins
  for (let k = 1; k < seen.length; ++k) {
    const a = seen[k - 1]!, b = seen[k]!, isNear = b[2] < NEAREST;
    if (a[2] < NEAREST && isNear) continue;
    if (!pen) path += `M${shown(a[2] < NEAREST ? cut(a, b) : a)}`;
    path += `L${shown(isNear ? cut(b, a) : b)}`;
    pen = !isNear;
  }
  return path;
}
