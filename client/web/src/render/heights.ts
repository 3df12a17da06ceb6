// What the terrain's own functions say of the ground of one world: the height somewhere, and between which heights the ray march has to look.

import { FloatType, NearestFilter, RGBAFormat, WebGLRenderTarget } from 'three';
import type { Tools } from './panes';
import type { Pose } from './view';

const BOUNDS_SIDE = 512; // samples over the ground around the camera
const BOUNDS_MARGIN = 4000; // metres that the camera may fly before it is looked again
const HEIGHT_MARGIN = 400; // metres for what lies between the samples

export class Heights {
  private bounds: Pose | undefined; // where it was looked last
  private looking = false;

  constructor(
    private readonly tools: Tools,
    private readonly horizon: number,
  ) {}

  /** Metres. */
  async at(pose: Pose): Promise<number> {
    return (await this.around(pose, 1, 0))[0]!;
  }

  get boundsAreKnown(): boolean {
    return this.bounds !== undefined;
  }
  boundsAreDue(at: Pose): boolean {
    return !this.looking && (!this.bounds || Math.hypot(at.x - this.bounds.x, at.z - this.bounds.z) > BOUNDS_MARGIN * 256);
  }
  async findBounds(at: Pose): Promise<void> {
    this.looking = true;
    try {
      const heights = await this.around(at, BOUNDS_SIDE, (2 * (this.horizon + BOUNDS_MARGIN)) / BOUNDS_SIDE);
      let low = Infinity, high = -Infinity;
      for (let k = 0; k < heights.length; k += 4) (low = Math.min(low, heights[k]!)), (high = Math.max(high, heights[k]!));
      this.bounds = at;
      this.tools.programs.own.marchLowest.value = low - HEIGHT_MARGIN;
      this.tools.programs.own.marchHighest.value = high + HEIGHT_MARGIN;
    } finally {
      this.looking = false;
    }
  }

  /** Of each point of a grid four numbers, the first its height; `spacing` in metres. */
  private async around(at: Pose, side: number, spacing: number): Promise<Float32Array> {
    const { renderer, uniforms, programs } = this.tools;
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
