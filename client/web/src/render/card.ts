// The graphics card's work: what was given to it and is not known to be done. Nobody ever waits for it.

import type { Pane, Portion } from './panes';

export interface Part {
  pane: Pane;
  portion: Portion;
}

export class Card {
  private given: { sync: WebGLSync; at: number; parts: Part[] } | undefined;
  private quickest = Infinity; // ms: what looking itself takes

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** What was drawn since `at`. */
  give(parts: Part[], at: number): void {
    if (parts.length === 0) return;
    this.given = { sync: this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0)!, at, parts };
    this.gl.flush();
  }

  /** Whether it has done what it was given; its panes are then told how long that took. */
  isDone(): boolean {
    if (!this.given) return true;
    const { sync, at, parts } = this.given;
    if (this.gl.clientWaitSync(sync, 0, 0) === this.gl.TIMEOUT_EXPIRED) return false;
    this.gl.deleteSync(sync);
    const took = performance.now() - at;
    this.quickest = Math.min(this.quickest, took);
    const total = parts.reduce((sum, { portion }) => sum + portion.estimate, 0);
    for (const { pane, portion } of parts) pane.measured(portion, ((took - 0.8 * this.quickest) * portion.estimate) / total);
    this.given = undefined;
    return true;
  }
}
