// The page's poses: the newest, and those that the server has not answered.

import type { Camera } from '../stream/stream';

const MOST = 256; // not answered; older ones are forgotten

export class Poses {
  newest: Camera | undefined;
  number = 0; // the page's, of the newest
  private readonly sent = new Map<bigint, number>(); // by the stream's sequence: when

  /** One was sent; sequence 0: there is no connection. */
  add(sequence: bigint): void {
    if (sequence === 0n) return;
    this.sent.set(sequence, performance.now());
    if (this.sent.size > MOST) this.sent.delete(this.sent.keys().next().value!);
  }

  /** Milliseconds since the pose that is answered now was sent; 0: unknown. */
  answered(sequence: bigint): number {
    const at = this.sent.get(sequence);
    for (const earlier of this.sent.keys()) if (earlier <= sequence) this.sent.delete(earlier);
    return at === undefined ? 0 : performance.now() - at;
  }
  get allAnswered(): boolean {
    return this.sent.size === 0;
  }
  /** Another connection answers none of them. */
  forget(): void {
    this.sent.clear();
  }
}
