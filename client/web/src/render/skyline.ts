// The skyline of a ray march (common/shaders/march.glsl), as the desktop client has it (client/render/march_pass.cpp): drawn before the
// march of the same view, some columns at a time.

import { FloatType, NearestFilter, RedFormat, WebGLRenderTarget, WebGLRenderer } from 'three';
import type { Programs } from './programs';
import { View, rightOf, tangentsOf } from './view';

const CELLS = 13 * 8; // rows, to 32.8 km

/** The directions between a picture's corners, half the circle each way where it sees straight up or down. */
function sectorOf(view: View, mostColumns: number): { half: number; perRadian: number; columns: number } {
  const { pitch } = view.pose, [tx, ty] = tangentsOf(view);
  const ahead = Math.cos(pitch) - ty * Math.sin(Math.abs(pitch));
  const half = ahead > 0 ? Math.atan(tx / ahead) : Math.PI;
  const perRadian = Math.min(view.height / (2 * ty), (mostColumns - 2) / (2 * half));
  return { half, perRadian, columns: Math.ceil(2 * half * perRadian) + 2 };
}

export class Skyline {
  private columns = 0;
  private drawn = 0; // columns
  private readonly target = new WebGLRenderTarget(1, CELLS, { type: FloatType, format: RedFormat, minFilter: NearestFilter, magFilter: NearestFilter, depthBuffer: false, generateMipmaps: false });

  get left(): number {
    return this.columns - this.drawn;
  }
  /** How many columns a view's has, about. */
  static columnsOf(view: View): number {
    return sectorOf(view, Infinity).columns;
  }

  begin(view: View, renderer: WebGLRenderer): void {
    this.columns = sectorOf(view, renderer.capabilities.maxTextureSize).columns;
    this.drawn = 0;
    this.target.setSize(this.columns, CELLS);
  }

  /** For the march, and for draw(), of the view of begin(). */
  setUniforms(view: View, { own }: Programs, renderer: WebGLRenderer): void {
    const { half, perRadian } = sectorOf(view, renderer.capabilities.maxTextureSize), right = rightOf(view.pose);
    own.skylineAhead.value = [right[2], -right[0]];
    own.skylineHalf.value = half;
    own.skylinePerRadian.value = perRadian;
    own.skyline.value = this.target.texture;
  }

  draw(programs: Programs, renderer: WebGLRenderer, columns: number): void {
    programs.skyline.run(renderer, this.target, { x: this.drawn, y: 0, width: columns, height: CELLS });
    this.drawn += columns;
  }
}
