// For a page of its own: heights of edited ground as the viewer's shaders compute them, on grids around places.

import { FloatType, NearestFilter, RGBAFormat, WebGLRenderTarget, WebGLRenderer } from 'three';
import type { EditSquare } from '../../../client/web/src/messages';
import { Edits } from '../../../client/web/src/render/edits';
import { Programs } from '../../../client/web/src/render/programs';
import { ViewUniforms } from '../../../client/web/src/render/view';

export interface Question {
  source: string;
  seed: number;
  squares: (Omit<EditSquare, 'posts'> & { posts: number[] })[];
  grids: { x: number; z: number }[]; // their middles, in steps
  side: number; // samples
  spacing: number; // metres
}
export type Answer = { renderer: string; bits: number[][] }; // of each grid, as uint32

async function editedHeights({ source, seed, squares, grids, side, spacing }: Question): Promise<Answer> {
  const renderer = new WebGLRenderer({ canvas: document.createElement('canvas') }), uniforms = new ViewUniforms();
  const gl = renderer.getContext();
  gl.getExtension('EXT_color_buffer_float');
  const edits = new Edits(renderer, uniforms), programs = new Programs(source, uniforms);
  const complaint = await programs.compile(['heights'], renderer);
  if (complaint) throw new Error(complaint);
  edits.apply(squares.map((square) => ({ ...square, posts: Int32Array.from(square.posts) })), []);
  uniforms.all.viewSeed.value = seed;
  const target = new WebGLRenderTarget(side, side, { type: FloatType, format: RGBAFormat, minFilter: NearestFilter, magFilter: NearestFilter, depthBuffer: false });
  const bits: number[][] = [];
  for (const { x, z } of grids) {
    const pose = { x, z, remainderX: 0, remainderZ: 0, y: 0, yaw: 0, pitch: 0 };
    uniforms.set({ pose, width: side, height: side, verticalFov: 1, horizon: 32_000 });
    edits.moveTo(pose);
    programs.own.heightsSide.value = side;
    programs.own.heightsSpacing.value = spacing;
    programs.heights.run(renderer, target);
    const out = new Float32Array(4 * side * side);
    await renderer.readRenderTargetPixelsAsync(target, 0, 0, side, side, out);
    bits.push([...new Uint32Array(out.buffer)].filter((_, k) => k % 4 === 0));
  }
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  return { renderer: String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER)), bits };
}
Object.assign(globalThis, { editedHeights });
