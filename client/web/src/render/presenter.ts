// Puts finished pictures into the window: side by side, each stretched over all of it and cut at the divider.

import type { Texture, WebGLRenderer } from 'three';
import type { Dots } from './dots';
import { FullScreen } from './full_screen';
import type { Pane } from './panes';
import { PRESENT } from './shaders';

export interface Size {
  width: number; // pixels
  height: number;
}

export class Presenter {
  private readonly own = { picture: { value: null as Texture | null }, windowSize: { value: [1, 1] } };
  private readonly program = new FullScreen(PRESENT, this.own);

  constructor(private readonly renderer: WebGLRenderer) {}

  /** The left pane up to the pixel `divider`, with dots where there are some, the right one from there on. */
  present(left: Pane, right: Pane, divider: number, { width, height }: Size, dots: Dots | undefined): void {
    this.own.windowSize.value = [width, height];
    this.renderer.setRenderTarget(null);
    this.renderer.setScissorTest(true);
    for (const [pane, from, to] of [
      [left, 0, divider],
      [right, divider, width],
    ] as const) {
      if (to <= from || !pane.shown) continue;
      this.renderer.setScissor(from, 0, to - from, height);
      this.own.picture.value = pane.shown.picture.texture;
      this.program.run(this.renderer, null);
      if (pane === left) dots?.draw(this.renderer, pane.shownView!, pane.shown.surface);
    }
    this.renderer.setScissorTest(false);
  }
}
