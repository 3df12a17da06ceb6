// The page's side of the painter: what it said of its frames, and whether it has heard everything.

import PainterWorker from '../painter.worker?worker';
import type { FromPainter, ToPainter } from '../messages';
import { Pose, samePose } from '../render/view';

const REST = 2; // frames with one pose, then it rests

export type Frames = Extract<FromPainter, { kind: 'frames' }>;

export class PainterLink {
  frames: Frames | undefined; // the last
  private messages = 0; // that were sent
  private pose: Pose | undefined; // the last
  private framesAtRest = 0; // since it changed
  private readonly worker = new PainterWorker();

  constructor(on: (message: FromPainter) => void, onFailure: (sentence: string) => void) {
    this.worker.onmessage = ({ data }: MessageEvent<FromPainter>) => {
      if (data.kind === 'frames') this.frames = data;
      on(data);
    };
    this.worker.onerror = (event) => onFailure(event.message);
  }

  send(message: ToPainter, transfer: Transferable[] = []): void {
    ++this.messages;
    this.worker.postMessage(message, transfer);
  }

  /** In each frame. */
  look(pose: Pose, verticalFov: number): void {
    const rests = this.pose !== undefined && samePose(this.pose, pose);
    this.framesAtRest = rests ? this.framesAtRest + 1 : 0;
    if (rests && this.framesAtRest !== REST) return;
    this.pose = pose;
    this.send({ kind: 'pose', pose, verticalFov, rests });
  }

  /** Whether the picture is all that will be made of what was sent and of so many of the engine's changes. */
  hasDrawn(changes: number): boolean {
    const { frames } = this;
    return frames !== undefined && frames.finest && frames.messages === this.messages && frames.changes === changes;
  }
}
