// The page's client: the poses that it is given, no more than are worth an iteration, and whether it has all that will come for the last.

import { Client } from '../../package/client';
import EngineWorker from '../engine.worker?worker';
import type { Camera, FromEngine } from '../messages';
import { Pose, samePose } from '../render/view';

const POSE_INTERVAL = 33; // ms: poses a second at most 30

export class EngineLink extends Client {
  private posed = 0; // poses given
  private posedAt = 0;
  private pose: Pose | undefined; // the last of them

  constructor(on: (message: FromEngine) => void, onFailure: (sentence: string) => void) {
    const worker = new EngineWorker();
    super(on, worker);
    worker.onerror = (event) => onFailure(event.message);
  }

  /** Gives it a pose that it does not have, where it is time for one. */
  show(pose: Pose, lens: Pick<Camera, 'verticalFov' | 'width' | 'height'>, now: number): void {
    if (now - this.posedAt < POSE_INTERVAL || this.knows(pose)) return;
    this.posedAt = now;
    this.pose = pose;
    const { x, y, z, yaw, pitch } = pose;
    this.send({ kind: 'pose', number: ++this.posed, camera: { x, z, y, yaw, pitch, ...lens } });
  }
  /** The next pose is given even where it is the last one's. */
  lookAgain(): void {
    this.pose = undefined;
  }
  knows(pose: Pose): boolean {
    return this.pose !== undefined && samePose(this.pose, pose);
  }

  /** Whether the mesh is all that will come for this pose; what was said of an earlier pose or connection does not count. */
  isAtRest(pose: Pose): boolean {
    return this.lost === '' && this.knows(pose) && this.figures !== undefined && this.figures.settled && this.figures.pose === this.posed;
  }

  protected override keep(message: FromEngine): void {
    super.keep(message);
    if (message.kind === 'world') this.lookAgain(); // told again, and nothing is at rest before it is answered
  }
}
