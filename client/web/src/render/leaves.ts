// The leaves of the mesh as three.js objects: one buffer of integers each, drawn relative to the camera's own step.

import { BufferAttribute, BufferGeometry, Camera, DoubleSide, GLSL3, IntType, LessDepth, Mesh, NoBlending, RawShaderMaterial, Scene, WebGLRenderTarget, WebGLRenderer } from 'three';
import { cornerX, cornerZ } from '../codec/mesh';
import type { LeafBuffers } from '../messages';
import { MESH_FRAGMENT, MESH_VERTEX } from './shaders';
import { STEPS_PER_METRE, View, ViewUniforms, mayBeSeen } from './view';

const NEAR = 0.1; // metres before the camera where the mesh is cut off
const FARTHEST = 2 ** 30; // steps: a stale mesh after a jump; offsets stay within 32 bits

interface Slot {
  mesh: Mesh<BufferGeometry, RawShaderMaterial>;
  leaf: LeafBuffers; // its corners are on the graphics card and no longer here
}

export class Leaves {
  version = 0; // grows whenever what would be drawn changes
  private readonly scene = new Scene();
  private readonly camera = new Camera();
  private readonly slots = new Map<string, Slot>();
  private readonly own = { leafOffset: { value: [0, 0, 0] }, leafLevel: { value: 0 }, edges: { value: 0 }, near: { value: NEAR } };
  private readonly material: RawShaderMaterial;

  constructor(view: ViewUniforms) {
    this.material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: MESH_VERTEX,
      fragmentShader: MESH_FRAGMENT,
      uniforms: { ...view.all, ...this.own },
      side: DoubleSide,
      blending: NoBlending,
      depthFunc: LessDepth,
    });
    this.scene.matrixWorldAutoUpdate = false;
    this.camera.matrixWorldAutoUpdate = false;
  }

  apply(gone: readonly string[], fresh: readonly LeafBuffers[], clear: boolean): void {
    ++this.version;
    for (const key of clear ? [...this.slots.keys()] : gone) this.drop(key);
    for (const leaf of fresh) {
      this.drop(leaf.key);
      if (leaf.corners.length > 0) this.put(leaf);
    }
  }

  /** Clears the surface and draws into it. */
  draw(renderer: WebGLRenderer, view: View, surface: WebGLRenderTarget, edges: boolean): void {
    const { pose } = view;
    const y = Math.floor(pose.y * STEPS_PER_METRE), metres = 1 / STEPS_PER_METRE;
    this.own.edges.value = edges ? 1 : 0;
    for (const { mesh, leaf } of this.slots.values()) {
      const x = cornerX(leaf.address) - pose.x, z = cornerZ(leaf.address) - pose.z;
      const { low, high } = leaf;
      mesh.visible =
        Math.abs(x) < FARTHEST &&
        Math.abs(z) < FARTHEST &&
        mayBeSeen(view, [(x + low[0] - 1) * metres, (low[2] - y - 1) * metres, (z + low[1] - 1) * metres], [(x + high[0]) * metres, (high[2] - y) * metres, (z + high[1]) * metres]);
      mesh.userData['offset'] = [x, z, -y];
    }
    renderer.setRenderTarget(surface);
    renderer.clear();
    renderer.render(this.scene, this.camera);
  }

  private put(leaf: LeafBuffers): void {
    const geometry = new BufferGeometry();
    const positions = new BufferAttribute(leaf.corners, 3);
    positions.gpuType = IntType;
    positions.onUpload(() => {
      (positions as { array: unknown }).array = undefined; // the card has it
    });
    geometry.setAttribute('position', positions);
    const mesh = new Mesh(geometry, this.material);
    mesh.frustumCulled = false;
    mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
    mesh.onBeforeRender = () => {
      this.own.leafOffset.value = mesh.userData['offset'] as number[];
      this.own.leafLevel.value = leaf.address.level;
      this.material.uniformsNeedUpdate = true;
    };
    this.scene.add(mesh);
    this.slots.set(leaf.key, { mesh, leaf: { ...leaf, corners: new Int32Array(0) } });
  }

  private drop(key: string): void {
    const slot = this.slots.get(key);
    if (!slot) return;
    this.scene.remove(slot.mesh);
    slot.mesh.geometry.dispose();
    this.slots.delete(key);
  }
}
