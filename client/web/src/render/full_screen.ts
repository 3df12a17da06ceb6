// A program that is run once for every sample of a target, or of a rectangle of it.

import { BufferGeometry, Camera, GLSL3, Mesh, NoBlending, RawShaderMaterial, Scene, WebGLRenderTarget, WebGLRenderer } from 'three';
import { FULL_SCREEN } from './shaders';
import type { Uniform } from './view';

const triangle = new BufferGeometry();
triangle.setDrawRange(0, 3);

/** Samples, from the bottom left. */
export interface Rectangle {
  x: number;
  y: number;
  width: number;
  height: number;
}

export class FullScreen {
  readonly material: RawShaderMaterial;
  private readonly scene = new Scene();
  private readonly camera = new Camera();

  constructor(fragment: string, uniforms: Record<string, Uniform>) {
    this.material = new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: FULL_SCREEN, fragmentShader: fragment, uniforms, depthTest: false, depthWrite: false, blending: NoBlending });
    const mesh = new Mesh(triangle, this.material);
    mesh.frustumCulled = false;
    this.scene.add(mesh);
  }

  run(renderer: WebGLRenderer, target: WebGLRenderTarget | null, only?: Rectangle): void {
    if (target) {
      target.scissorTest = only !== undefined;
      if (only) target.scissor.set(only.x, only.y, only.width, only.height);
    }
    renderer.setRenderTarget(target);
    renderer.render(this.scene, this.camera);
    if (target) target.scissorTest = false;
  }

  dispose(): void {
    this.material.dispose();
  }
}
