// Candidates for vertices as dots over the picture of the mesh that is shown, in pixels of the screen, where its surface does not hide them; as the desktop client draws them
// (client/render/candidate_pass.cpp, client/viewer/leaf_colours.cpp).

import { BufferAttribute, BufferGeometry, Camera, DataTexture, DynamicDrawUsage, GLSL3, NormalBlending, Points, RawShaderMaterial, Scene, WebGLRenderTarget, WebGLRenderer } from 'three';
import type { Candidates } from '../messages';
import { errorColour } from './colours';
import { DOT_FRAGMENT, DOT_VERTEX } from './shaders';
import { STEPS_PER_METRE, View, ViewUniforms } from './view';

export class Dots {
  version = 0; // grows whenever what would be drawn changes
  private candidates: Candidates | undefined;
  private geometry = new BufferGeometry();
  private offsets = new Float32Array();
  private readonly scene = new Scene();
  private readonly camera = new Camera();
  private readonly points: Points<BufferGeometry, RawShaderMaterial>;
  private readonly own = { dotSurface: { value: null as DataTexture | null }, dotSize: { value: 2 } };

  constructor(private readonly uniforms: ViewUniforms) {
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: DOT_VERTEX,
      fragmentShader: DOT_FRAGMENT,
      uniforms: { ...uniforms.all, ...this.own },
      depthTest: false,
      depthWrite: false,
      transparent: true,
      blending: NormalBlending,
    });
    this.points = new Points(this.geometry, material);
    this.points.frustumCulled = false;
    this.scene.add(this.points);
    this.scene.matrixWorldAutoUpdate = false;
    this.camera.matrixWorldAutoUpdate = false;
  }

  /** The worst first; they are drawn last. Nothing: none. */
  set(candidates: Candidates | undefined): void {
    if (!candidates && !this.candidates) return;
    ++this.version;
    this.candidates = candidates;
    const count = candidates?.errors.length ?? 0;
    const paint = new Float32Array(3 * count);
    for (let k = 0; k < count; ++k) paint.set(errorColour(candidates!.errors[count - 1 - k]!, candidates!.threshold), 3 * k);
    this.offsets = new Float32Array(3 * count);
    this.geometry.dispose();
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute('position', new BufferAttribute(this.offsets, 3).setUsage(DynamicDrawUsage));
    this.geometry.setAttribute('paint', new BufferAttribute(paint, 3));
    this.points.geometry = this.geometry;
  }

  /** Into the window, over the picture of this surface, which may be coarser. */
  draw(renderer: WebGLRenderer, view: View, surface: WebGLRenderTarget): void {
    const count = this.candidates?.errors.length ?? 0;
    if (count === 0) return;
    this.uniforms.set(view);
    const { x, z, points } = this.candidates!, { pose } = view;
    // Whole steps first, so that far out is as exact as here.
    const ownX = x - pose.x, ownZ = z - pose.z, metres = 1 / STEPS_PER_METRE;
    for (let k = 0; k < count; ++k) {
      const from = 3 * (count - 1 - k), to = 3 * k;
      this.offsets[to] = (ownX + points[from]! - pose.remainderX) * metres;
      this.offsets[to + 1] = points[from + 2]! * metres - pose.y;
      this.offsets[to + 2] = (ownZ + points[from + 1]! - pose.remainderZ) * metres;
    }
    this.geometry.getAttribute('position').needsUpdate = true;
    this.own.dotSurface.value = surface.texture as DataTexture;
    this.own.dotSize.value = Math.max(2, Math.round(view.height / 110));
    renderer.setRenderTarget(null);
    renderer.render(this.scene, this.camera);
  }
}
