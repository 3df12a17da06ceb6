// Between which heights the ray march of one world has to look, by the terrain's own functions.

import { FloatType, NearestFilter, RGBAFormat, WebGLRenderTarget, type WebGLRenderer } from 'three';
import type { Edits } from './edits';
import type { Pose, ViewUniforms } from './view';
import type { WorldPrograms } from './world_programs';

const BOUNDS_SIDE = 512; // samples over the ground around the camera
const BOUNDS_MARGIN = 4000; // metres that the camera may fly before it is looked again
const HEIGHT_MARGIN = 400; // metres for what lies between the samples

export class Heights {
  private bounds: { at: Pose; low: number; high: number } | undefined; // of the heights there, where it was looked last
  private looking = false;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly uniforms: ViewUniforms,
    private readonly programs: WorldPrograms,
    private readonly edits: Edits,
    private readonly horizon: number,
  ) {}

  get boundsAreKnown(): boolean {
    return this.bounds !== undefined;
  }
  boundsAreDue(at: Pose): boolean {
    return !this.looking && (!this.bounds || Math.hypot(at.x - this.bounds.at.x, at.z - this.bounds.at.z) > BOUNDS_MARGIN * 256);
  }
  async findBounds(at: Pose): Promise<void> {
    this.looking = true;
    try {
      const heights = await this.around(at, BOUNDS_SIDE, (2 * (this.horizon + BOUNDS_MARGIN)) / BOUNDS_SIDE);
      if (!heights) return;
      let low = Infinity, high = -Infinity;
      for (let k = 0; k < heights.length; k += 4) (low = Math.min(low, heights[k]!)), (high = Math.max(high, heights[k]!));
      this.bounds = { at, low, high };
      this.setBounds();
    } finally {
      this.looking = false;
    }
  }

  /** What lies between samples of the ground, and edits anywhere, widen the bounds. */
  setBounds(): void {
    if (!this.bounds) return;
    const { own } = this.programs.current, { low, high } = this.bounds, { below, above } = this.edits.bounds; // whoever wants bounds marches
    own.marchLowest.value = low - HEIGHT_MARGIN + below;
    own.marchHighest.value = high + HEIGHT_MARGIN + above;
  }

  /** Of each point of a grid four numbers, the first its height; `spacing` in metres. */
  private async around(at: Pose, side: number, spacing: number): Promise<Float32Array | undefined> {
    const { renderer, uniforms } = this, programs = await this.programs.heights();
    if (!programs) return undefined;
    const target = new WebGLRenderTarget(side, side, { type: FloatType, format: RGBAFormat, minFilter: NearestFilter, magFilter: NearestFilter, depthBuffer: false });
    try {
      uniforms.set({ pose: at, width: side, height: side, verticalFov: 1, horizon: this.horizon });
      programs.own.heightsSide.value = side;
      programs.own.heightsSpacing.value = spacing;
      programs.heights.run(renderer, target);
      const out = new Float32Array(4 * side * side);
      await renderer.readRenderTargetPixelsAsync(target, 0, 0, side, side, out);
      return out;
    } finally {
      target.dispose();
    }
  }
}
