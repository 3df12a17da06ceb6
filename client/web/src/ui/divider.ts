// The line between mesh and ray march. A finger takes its handle, a mouse any of it, keys move it where it has the focus.

import { element } from './notices';

const LEAST = 0.02, STEP = 0.02; // shares of the width

export class Divider {
  private readonly box = element('divider');
  private share = 0.5;

  constructor(private readonly onMoved: (share: number) => void) {
    const { box } = this;
    box.addEventListener('pointerdown', (event) => {
      event.preventDefault();
      box.setPointerCapture(event.pointerId);
    });
    box.addEventListener('pointermove', (event) => {
      if (box.hasPointerCapture(event.pointerId)) this.move(event.clientX / innerWidth);
    });
    box.addEventListener('keydown', (event) => {
      const ways: Record<string, number> = { ArrowLeft: -1, ArrowRight: 1 };
      const way = ways[event.key];
      if (way === undefined) return;
      event.preventDefault();
      event.stopPropagation(); // they do not look around
      this.by(way);
    });
  }

  /** So many steps to the right. */
  by(steps: number): void {
    this.move(this.share + steps * STEP);
  }

  show(shown: boolean, share: number): void {
    this.share = share;
    this.box.hidden = !shown;
    this.box.style.left = `${share * 100}%`;
    this.box.setAttribute('aria-valuenow', String(Math.round(share * 100)));
  }

  private move(share: number): void {
    this.onMoved(Math.min(1 - LEAST, Math.max(LEAST, share)));
  }
}
