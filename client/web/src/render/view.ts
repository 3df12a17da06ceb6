// What a picture shows: a camera in a world, as the shaders take it. Positions are split into whole cells, whole steps and a remainder.

import type { Texture } from 'three';

export const STEPS_PER_METRE = 256;
const CELL = 2 ** 20; // steps

export type Vec3 = [number, number, number];

export interface Pose {
  x: number; // whole steps
  z: number;
  remainderX: number; // steps, [0, 1): for drawing only
  remainderZ: number;
  y: number; // metres
  yaw: number; // radians; 0 looks along -z, positive turns left
  pitch: number;
}

export const samePose = (a: Pose, b: Pose): boolean => (Object.keys(a) as (keyof Pose)[]).every((k) => a[k] === b[k]);

export interface View {
  pose: Pose;
  width: number; // samples
  height: number;
  verticalFov: number; // radians
  horizon: number; // metres
  rests?: boolean; // known to stay for a while; says nothing of what is seen
}

/** Metres from a pose to a place given in steps, metres and steps. */
export const distanceTo = (p: Pose, at: { x: number; y: number; z: number }): number => Math.hypot((at.x - p.x) / STEPS_PER_METRE, at.y - p.y, (at.z - p.z) / STEPS_PER_METRE);

export const forwardOf = (p: Pose): Vec3 => [-Math.sin(p.yaw) * Math.cos(p.pitch), Math.sin(p.pitch), -Math.cos(p.yaw) * Math.cos(p.pitch)];
export const rightOf = (p: Pose): Vec3 => [Math.cos(p.yaw), 0, -Math.sin(p.yaw)];
export const upOf = (p: Pose): Vec3 => [Math.sin(p.yaw) * Math.sin(p.pitch), Math.cos(p.pitch), Math.cos(p.yaw) * Math.sin(p.pitch)];

/** Tangents of the half angles, horizontal and vertical. */
export function tangentsOf(view: Pick<View, 'width' | 'height' | 'verticalFov'>): [number, number] {
  const t = Math.tan(view.verticalFov / 2);
  return [(t * view.width) / view.height, t];
}

export interface Uniform<T = unknown> {
  value: T;
}

/** The uniforms that all programs of a picture share. */
export class ViewUniforms {
  readonly all = {
    viewCell: { value: [0, 0] },
    viewSteps: { value: [0, 0] },
    viewRemainder: { value: [0, 0] },
    viewCameraY: { value: 0 },
    viewForward: { value: [0, 0, -1] },
    viewRight: { value: [1, 0, 0] },
    viewUp: { value: [0, 1, 0] },
    viewTangents: { value: [1, 1] },
    viewScale: { value: [1, 1] },
    viewSize: { value: [1, 1] },
    viewHorizon: { value: 1 },
    viewSeed: { value: 0 },
    viewFiltered: { value: 1 },
    editsTable: { value: null as Texture | null },
    editsPosts: { value: null as Texture | null },
    editsCell: { value: [0, 0] },
    editsHeld: { value: 0 },
    remainder: { value: [0, 0, 0] },
  };

  set(view: View): void {
    const { pose } = view, u = this.all;
    const cellX = Math.floor(pose.x / CELL), cellZ = Math.floor(pose.z / CELL);
    u.viewCell.value = [cellX, cellZ];
    u.viewSteps.value = [pose.x - cellX * CELL, pose.z - cellZ * CELL];
    u.viewRemainder.value = [pose.remainderX, pose.remainderZ];
    u.viewCameraY.value = pose.y;
    u.viewForward.value = forwardOf(pose);
    u.viewRight.value = rightOf(pose);
    u.viewUp.value = upOf(pose);
    const [tx, ty] = tangentsOf(view);
    u.viewTangents.value = [tx, ty];
    u.viewScale.value = [1 / tx, 1 / ty];
    u.viewSize.value = [view.width, view.height];
    u.viewHorizon.value = view.horizon;
    const y = pose.y * STEPS_PER_METRE;
    u.remainder.value = [pose.remainderX, pose.remainderZ, y - Math.floor(y)];
  }
}

/** The four sides of the view's pyramid: whether a box, in metres relative to the camera, may be seen. Never false when it is. */
export function mayBeSeen(view: View, low: Vec3, high: Vec3): boolean {
  const f = forwardOf(view.pose), r = rightOf(view.pose), u = upOf(view.pose);
  const [tx, ty] = tangentsOf(view);
  for (let k = 0; k < 5; ++k) {
    const side = k < 2 ? r : u, t = k < 2 ? tx : ty, sign = k % 2 === 0 ? 1 : -1;
    let most = 0;
    for (let c = 0; c < 3; ++c) {
      const n = k === 4 ? f[c]! : t * f[c]! + sign * side[c]!;
      most += n * (n > 0 ? high[c]! : low[c]!);
    }
    if (most < 0) return false;
  }
  return true;
}
