// The page's side of the engine: the last of what it said, and the poses that it is given.

import EngineWorker from '../engine.worker?worker';
import type { Camera, Figures, FromEngine, MemberTold, ToEngine, WorldTold } from '../messages';
import { Pose, samePose } from '../render/view';

const POSE_INTERVAL = 33; // ms: poses a second at most 30

export class EngineLink {
  world: WorldTold | undefined;
  figures: Figures | undefined;
  others: MemberTold[] = [];
  ground: number | undefined; // metres, of the mesh below the newest pose
  lost = ''; // why there is no connection
  private posed = 0; // poses given
  private posedAt = 0;
  private pose: Pose | undefined; // the last of them
  private readonly worker = new EngineWorker();

  /** `on` is called when it is kept. */
  constructor(on: (message: FromEngine) => void, onFailure: (sentence: string) => void) {
    this.worker.onmessage = ({ data }: MessageEvent<FromEngine>) => {
      this.keep(data);
      on(data);
    };
    this.worker.onerror = (event) => onFailure(event.message);
  }

  send(message: ToEngine, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  /** Gives it a pose that it does not have, where it is time for one. */
  look(pose: Pose, lens: Pick<Camera, 'verticalFov' | 'width' | 'height'>, now: number): void {
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

  private keep(message: FromEngine): void {
    switch (message.kind) {
      case 'world':
        this.world = message.world;
        this.lost = '';
        this.lookAgain(); // told again, and nothing is at rest before it is answered
        break;
      case 'lost':
        this.lost = message.sentence;
        break;
      case 'figures':
        this.figures = message.figures;
        break;
      case 'granted':
        if (this.world) this.world.threshold = message.threshold;
        break;
      case 'ground':
        this.ground = message.metres;
        break;
      case 'members':
        this.others = message.members;
        break;
    }
  }
}
