// The programs of one world, which hold its terrain's functions.

import { FloatType, RGBAFormat, Texture, WebGLRenderTarget, WebGLRenderer } from 'three';
import { FullScreen } from './full_screen';
import { terrainShaders } from './shaders';
import type { Uniform, ViewUniforms } from './view';

export class Programs {
  readonly skyline: FullScreen;
  readonly march: FullScreen;
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
    shadeSurface: { value: null as Texture | null },
    showNodes: { value: 0 },
    heightsSpacing: { value: 0 },
    heightsSide: { value: 1 },
  };
  /** An empty source is a world whose text is private. */
  constructor(source: string, view: ViewUniforms) {
    const texts = terrainShaders(source), uniforms: Record<string, Uniform> = { ...view.all, ...this.own };
    this.skyline = new FullScreen(texts.skyline, uniforms);
    this.march = new FullScreen(texts.march, uniforms);
    this.shade = new FullScreen(texts.shade, uniforms);
    this.heights = new FullScreen(texts.heights, uniforms);
  }

  /** With them compiled, or the driver's first complaint. */
  static async compile(source: string, view: ViewUniforms, renderer: WebGLRenderer): Promise<Programs | string> {
    const complaints: string[] = [];
    renderer.debug.onShaderError = (gl, program, vertex, fragment) => {
      complaints.push(gl.getShaderInfoLog(fragment) || gl.getShaderInfoLog(vertex) || gl.getProgramInfoLog(program) || 'no reason given');
    };
    const made = new Programs(source, view);
    try {
      // Errors show when a program is used.
      const tiny = new WebGLRenderTarget(1, 1, { type: FloatType, format: RGBAFormat, depthBuffer: false });
      for (const program of made.all) program.run(renderer, tiny);
      await renderer.readRenderTargetPixelsAsync(tiny, 0, 0, 1, 1, new Float32Array(4)); // a driver may compile only now
      tiny.dispose();
    } catch (error) {
      complaints.push(String(error));
    }
    if (complaints.length === 0) return made;
    made.dispose();
    return complaints[0]!.trim().slice(0, 300);
  }

  dispose(): void {
    for (const program of this.all) program.dispose();
  }
  private get all(): FullScreen[] {
    return [this.shade, this.heights, this.skyline, this.march];
  }
}
