// The leaves of the mesh in one buffer on the graphics card, drawn in one call: a copy of the slots that they lie in.
// A table that is written for each picture tells the vertex shader, block by block, where the leaf lies from the camera's own step.

import { BufferAttribute, BufferGeometry, Camera, DataTexture, DoubleSide, GLSL3, IntType, LessDepth, Mesh, NoBlending, RGBAIntegerFormat, RawShaderMaterial, Scene, WebGLRenderTarget, WebGLRenderer } from 'three';
import { BLOCK, type DrawnLeaf, SLOT, type ToPainterFromEngine } from '../messages';
import { MESH_FRAGMENT, MESH_VERTEX } from './shaders';
import { STEPS_PER_METRE, View, ViewUniforms, mayBeSeen } from './view';

const NEAR = 0.1; // metres before the camera where the mesh is cut off
const FARTHEST = 2 ** 30; // steps: a stale mesh after a jump; offsets stay within 32 bits
const COLUMNS = 512; // blocks in a row of the table

type Change = Extract<ToPainterFromEngine, { kind: 'change' }>;
interface Held {
  leaf: DrawnLeaf;
  blocks: Uint32Array; // numbers of those that it lies in
}

/** Integers of all blocks, for vertices and for the table. */
class Store {
  readonly geometry = new BufferGeometry();
  readonly table: DataTexture;
  readonly places: Int32Array; // of the table: x, z, y and level of each block's leaf; a negative level: not drawn
  private readonly positions: BufferAttribute;

  constructor(rows: number, before?: Store) {
    this.positions = new BufferAttribute(new Int32Array(SLOT * BLOCK * COLUMNS * rows), 3);
    this.positions.gpuType = IntType;
    if (before) this.positions.array.set(before.positions.array);
    this.geometry.setAttribute('position', this.positions);
    this.places = new Int32Array(4 * COLUMNS * rows);
    this.table = new DataTexture(this.places, COLUMNS, rows, RGBAIntegerFormat, IntType);
    this.table.internalFormat = 'RGBA32I';
  }
  get blocks(): number {
    return this.places.length / 4;
  }
  /** Slots and their numbers; those of a block, which travel together, lie together. */
  put(slots: Uint32Array, corners: Int32Array): void {
    const { array } = this.positions;
    let last = -1, from = 0;
    for (const slot of slots) {
      const block = Math.floor(slot / BLOCK);
      if (block !== last) this.positions.addUpdateRange(SLOT * BLOCK * (last = block), SLOT * BLOCK);
      for (let at = SLOT * slot, end = at + SLOT; at < end; ) array[at++] = corners[from++]!;
    }
    if (last >= 0) this.positions.needsUpdate = true; // without a range it would be all of it
  }
  dispose(): void {
    this.geometry.dispose();
    this.table.dispose();
  }
}

export class Leaves {
  version = 0; // grows whenever what would be drawn changes
  private readonly scene = new Scene();
  private readonly camera = new Camera();
  private readonly held = new Map<string, Held>();
  private end = 0; // of the blocks that were used
  private store = new Store(8);
  private readonly own = { leafTable: { value: null as DataTexture | null }, leafColumns: { value: COLUMNS }, leafBlock: { value: 3 * BLOCK }, edges: { value: 0 }, near: { value: NEAR } };
  private readonly mesh: Mesh<BufferGeometry, RawShaderMaterial>;

  constructor(view: ViewUniforms) {
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: MESH_VERTEX,
      fragmentShader: MESH_FRAGMENT,
      uniforms: { ...view.all, ...this.own },
      side: DoubleSide,
      blending: NoBlending,
      depthFunc: LessDepth,
    });
    this.mesh = new Mesh(this.store.geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.matrixAutoUpdate = this.mesh.matrixWorldAutoUpdate = false;
    this.scene.add(this.mesh);
    this.scene.matrixWorldAutoUpdate = false;
    this.camera.matrixWorldAutoUpdate = false;
  }

  apply({ gone, fresh, drawing, clear }: Change): void {
    ++this.version;
    if (clear) this.held.clear(), (this.end = 0);
    for (const key of gone) this.held.delete(key);
    const { ends, blocks, changed, corners } = drawing;
    for (const block of blocks) if (block >= this.end) this.end = block + 1;
    while (this.end > this.store.blocks) this.grow();
    this.store.put(changed, corners);
    fresh.forEach((leaf, k) => this.held.set(leaf.key, { leaf, blocks: blocks.slice(k === 0 ? 0 : ends[k - 1], ends[k]) }));
  }

  get areThere(): boolean {
    return this.end > 0;
  }

  /** Clears the surface and draws into it. */
  draw(renderer: WebGLRenderer, view: View, surface: WebGLRenderTarget, edges: boolean): void {
    this.own.edges.value = edges ? 1 : 0;
    this.place(view);
    this.own.leafTable.value = this.store.table;
    this.store.geometry.setDrawRange(0, 3 * BLOCK * this.end);
    renderer.setRenderTarget(surface);
    renderer.clear();
    if (this.end > 0) renderer.render(this.scene, this.camera);
  }

  /** Writes the table. */
  private place(view: View): void {
    const { pose } = view, { places, table } = this.store;
    const y = Math.floor(pose.y * STEPS_PER_METRE), metres = 1 / STEPS_PER_METRE;
    places.fill(-1);
    for (const { leaf, blocks } of this.held.values()) {
      const side = 2 ** (13 + leaf.address.level), x = leaf.address.i * side - pose.x, z = leaf.address.j * side - pose.z;
      const { low, high } = leaf;
      if (Math.abs(x) >= FARTHEST || Math.abs(z) >= FARTHEST) continue;
      if (!mayBeSeen(view, [(x + low[0] - 1) * metres, (low[2] - y - 1) * metres, (z + low[1] - 1) * metres], [(x + high[0]) * metres, (high[2] - y) * metres, (z + high[1]) * metres])) continue;
      for (const block of blocks) {
        places[4 * block] = x;
        places[4 * block + 1] = z;
        places[4 * block + 2] = -y;
        places[4 * block + 3] = leaf.address.level;
      }
    }
    table.needsUpdate = true;
  }

  private grow(): void {
    const before = this.store;
    this.store = new Store((2 * before.blocks) / COLUMNS, before);
    this.mesh.geometry = this.store.geometry;
    before.dispose();
  }
}
