// The page's side of the painter: what it said of its frames, and whether it has heard everything.

import PainterWorker from '../painter.worker?worker';
import type { FromPainter, ToPainter } from '../messages';
import { Pose, samePose } from '../render/view';

export type Frames = Extract<FromPainter, { kind: 'frames' }>;

export class PainterLink {
  frames: Frames | undefined; // the last
  private messages = 0; // that were sent
  private pose: Pose | undefined; // the last
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

  look(pose: Pose, verticalFov: number): void {
    if (this.pose && samePose(this.pose, pose)) return;
    this.pose = pose;
    this.send({ kind: 'pose', pose, verticalFov });
  }

  /** Whether the picture is all that will be made of what was sent and of so many of the engine's changes. */
  hasDrawn(changes: number): boolean {
    const { frames } = this;
    return frames !== undefined && frames.finest && frames.messages === this.messages && frames.changes === changes;
  }
}
