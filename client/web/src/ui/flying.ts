// How keys, mouse and fingers move the camera. No page: values in, pose out.

import { Pose, STEPS_PER_METRE, forwardOf, rightOf, samePose } from '../render/view';

const TURN = 0.0025; // radians a pixel
const LOWEST = 2; // metres above the ground
const HIGHEST = 30_000; // metres, absolute
const SLOWEST = 1, FASTEST = 5000; // metres a second
const FARTHEST = 2 ** 50; // steps

/** What is held down or was moved since the last step. */
export interface Input {
  forward: number; // -1..1
  right: number;
  up: number;
  sprint: boolean; // five times as fast
  turnX: number; // pixels, right and down
  turnY: number;
  wheel: number; // notches
}

export const atRest = (): Input => ({ forward: 0, right: 0, up: 0, sprint: false, turnX: 0, turnY: 0, wheel: 0 });

export function poseAt(x: number, y: number, z: number, yaw: number, pitch: number): Pose {
  const pose: Pose = { x: 0, z: 0, remainderX: 0, remainderZ: 0, y, yaw, pitch };
  [pose.x, pose.remainderX] = moved(0, 0, x);
  [pose.z, pose.remainderZ] = moved(0, 0, z);
  return pose;
}

function moved(whole: number, remainder: number, metres: number): [number, number] {
  const steps = remainder + metres * STEPS_PER_METRE, floor = Math.floor(steps);
  return [Math.min(FARTHEST, Math.max(-FARTHEST, whole + floor)), Math.min(steps - floor, 0.999999)];
}

const BESIDE = 60, ABOVE = 15; // metres

/** Near somebody, on the side that one comes from, looking at them. */
export function beside(from: Pose, at: { x: number; y: number; z: number }): Pose {
  const x = (from.x - at.x) / STEPS_PER_METRE, z = (from.z - at.z) / STEPS_PER_METRE, level = Math.hypot(x, z);
  const [dx, dz] = level > 1e-3 ? [x / level, z / level] : [0, 1];
  const pose: Pose = { ...from, y: at.y + ABOVE, yaw: Math.atan2(dx, dz), pitch: -Math.atan2(ABOVE, BESIDE) };
  [pose.x, pose.remainderX] = moved(at.x, 0, dx * BESIDE);
  [pose.z, pose.remainderZ] = moved(at.z, 0, dz * BESIDE);
  return pose;
}

export class Flying {
  pose: Pose;
  speed = 50; // metres a second
  constructor(start: Pose) {
    this.pose = start;
  }

  /** One step; the camera stays at least 2 m above `ground` (metres, where it is known) and on the lattice. */
  step(input: Input, seconds: number, ground: number | undefined): void {
    const pose = { ...this.pose };
    this.speed = Math.min(FASTEST, Math.max(SLOWEST, this.speed * 1.2 ** input.wheel));
    const turned = pose.yaw - input.turnX * TURN;
    pose.yaw = turned - 2 * Math.PI * Math.round(turned / (2 * Math.PI));
    pose.pitch = Math.min(1.55, Math.max(-1.55, pose.pitch - input.turnY * TURN));
    const f = forwardOf(pose), r = rightOf(pose);
    const metres = this.speed * (input.sprint ? 5 : 1) * seconds;
    if (input.forward !== 0 || input.right !== 0 || input.up !== 0) {
      [pose.x, pose.remainderX] = moved(pose.x, pose.remainderX, (f[0] * input.forward + r[0] * input.right) * metres);
      [pose.z, pose.remainderZ] = moved(pose.z, pose.remainderZ, (f[2] * input.forward + r[2] * input.right) * metres);
      pose.y = Math.min(HIGHEST, pose.y + (f[1] * input.forward + input.up) * metres);
    }
    if (ground !== undefined) pose.y = Math.max(pose.y, ground + LOWEST);
    if (!samePose(pose, this.pose)) this.pose = pose;
  }
}
