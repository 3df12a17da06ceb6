// The programs of one world, which hold its terrain's functions.

import { FloatType, RGBAFormat, Texture, WebGLRenderTarget, WebGLRenderer } from 'three';
import { FullScreen } from './full_screen';
import { terrainShaders } from './shaders';
import type { Uniform, ViewUniforms } from './view';

type Name = 'shade' | 'heights' | 'correct' | 'skyline' | 'march';

const CORRECTION_STEPS = 3; // as client/render/correction_pass.h

export class Programs {
  readonly skyline: FullScreen;
  readonly march: FullScreen;
  readonly correct: FullScreen;
  readonly shade: FullScreen;
  readonly heights: FullScreen;
  readonly own = {
    skyline: { value: null as Texture | null },
    skylineAhead: { value: [0, -1] },
    skylineHalf: { value: 1 },
    skylinePerRadian: { value: 1 },
    marchLowest: { value: -131072 },
    marchHighest: { value: 131072 },
    marchFineness: { value: 1 },
    correctSurface: { value: null as Texture | null },
    correctSteps: { value: CORRECTION_STEPS },
    shadeSurface: { value: null as Texture | null },
    showNodes: { value: 0 },
    heightsSpacing: { value: 0 },
    heightsSide: { value: 1 },
  };
  private readonly compiled: Partial<Record<Name, Promise<string>>> = {};

  readonly isNeutral: boolean;

  /** An empty source: neutral colours, and no ground for ray march and correction. */
  constructor(source: string, view: ViewUniforms) {
    this.isNeutral = source === '';
    const texts = terrainShaders(source), uniforms: Record<string, Uniform> = { ...view.all, ...this.own };
    this.skyline = new FullScreen(texts.skyline, uniforms);
    this.march = new FullScreen(texts.march, uniforms);
    this.correct = new FullScreen(texts.correct, uniforms);
    this.shade = new FullScreen(texts.shade, uniforms);
    this.heights = new FullScreen(texts.heights, uniforms);
  }

  /** Compiles those that are not yet, each once; the driver's first complaint, or nothing. Drivers compile in turn, some only when a
   *  program is used first: what is wanted soonest comes first, and ray march and correction only where they are wanted. */
  async compile(names: readonly Name[], renderer: WebGLRenderer): Promise<string> {
    let complaint = '';
    for (const name of names) complaint ||= await (this.compiled[name] ??= compiled(this[name], renderer));
    return complaint.trim().slice(0, 300);
  }

  dispose(): void {
    for (const program of [this.shade, this.heights, this.correct, this.skyline, this.march]) program.dispose();
  }
}

async function compiled(program: FullScreen, renderer: WebGLRenderer): Promise<string> {
  let complaint = '';
  renderer.debug.onShaderError = (gl, program, vertex, fragment) => {
    complaint ||= gl.getShaderInfoLog(fragment) || gl.getShaderInfoLog(vertex) || gl.getProgramInfoLog(program) || 'no reason given';
  };
  const tiny = new WebGLRenderTarget(1, 1, { type: FloatType, format: RGBAFormat, depthBuffer: false });
  try {
    program.run(renderer, tiny); // errors show when a program is used
    await renderer.readRenderTargetPixelsAsync(tiny, 0, 0, 1, 1, new Float32Array(4));
  } catch (error) {
    complaint ||= String(error);
  } finally {
    tiny.dispose();
  }
  return complaint;
}
