// The squares of edits that the page holds, as textures: a table of the squares around the camera, and the squares' posts with their
// pyramid (common/terrain/edited.glsl). As client/render/edit_texture.h.

import { DataTexture, IntType, NearestFilter, NearestMipmapNearestFilter, RedIntegerFormat, Vector2, type WebGLRenderer } from 'three';
import type { EditSquare } from '../messages';
import { type Pose, STEPS_PER_METRE, type ViewUniforms } from './view';

const CELLS = 17, SQUARES = 64; // of the table, and of a cell, a side
const TABLE = CELLS * SQUARES;
const TILE_SIDE = 128; // posts of a square
const LEVELS = 8;
const CELL = 2 ** 20; // steps

interface Slot {
  square: EditSquare;
  place: number;
}

function integers(data: Int32Array, side: number): DataTexture {
  const texture = new DataTexture(data, side, side, RedIntegerFormat, IntType);
  texture.internalFormat = 'R32I';
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

/** Of four texels the mean of their rises, and the most frequent of their materials, the first of these if there are several. */
function together(four: readonly number[]): number {
  let sum = 0, material = 0, most = 0;
  for (const v of four) {
    sum += v >> 4;
    let count = 0;
    for (const other of four) count += (other & 15) === (v & 15) ? 1 : 0;
    if (count > most) material = v & 15;
    most = Math.max(most, count);
  }
  return (sum >> 2) * 16 + material;
}

export class Edits {
  version = 0; // grows with every change
  private readonly slots = new Map<string, Slot>();
  private free: number[] = [];
  private columns = 0; // squares a side of `posts`
  private posts: DataTexture | undefined;
  private table: DataTexture | undefined;
  private cell = { x: 0, z: 0 }; // where the table begins

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly uniforms: ViewUniforms,
  ) {
    uniforms.all.editsTable.value = integers(new Int32Array(1), 1);
    uniforms.all.editsPosts.value = integers(new Int32Array(1), 1);
  }

  apply(fresh: readonly EditSquare[], gone: readonly string[]): void {
    for (const key of gone) {
      const slot = this.slots.get(key);
      if (slot) this.free.push(slot.place);
      this.slots.delete(key);
    }
    for (const square of fresh) {
      const slot = this.slots.get(square.key);
      if (!slot && this.free.length === 0) this.grow();
      const place = slot?.place ?? this.free.pop()!;
      this.slots.set(square.key, { square, place });
      this.upload(square.posts, place);
    }
    this.makeTable();
    ++this.version;
  }

  moveTo(pose: Pose): void {
    const x = Math.floor(pose.x / CELL) - (CELLS >> 1), z = Math.floor(pose.z / CELL) - (CELLS >> 1);
    if (x === this.cell.x && z === this.cell.z) return;
    this.cell = { x, z };
    this.makeTable();
  }

  /** By how much the ground may lie below and above the terrain's own: metres. The curve leaves the range of its posts a little. */
  get bounds(): { below: number; above: number } {
    let lowest = 0, highest = 0;
    for (const { square } of this.slots.values()) {
      lowest = Math.min(lowest, square.lowest);
      highest = Math.max(highest, square.highest);
    }
    const swing = 0.2875 * (highest - lowest);
    return { below: (lowest - swing) / STEPS_PER_METRE, above: (highest + swing) / STEPS_PER_METRE };
  }

  private grow(): void {
    this.columns = Math.max(4, 2 * this.columns);
    const side = this.columns * TILE_SIDE;
    this.posts?.dispose();
    const posts = (this.posts = integers(new Int32Array(1), side));
    posts.mipmaps = Array.from({ length: LEVELS }, (_, level) => ({ data: new Int32Array((side >> level) ** 2), width: side >> level, height: side >> level })) as unknown as typeof posts.mipmaps;
    posts.minFilter = NearestMipmapNearestFilter;
    this.renderer.initTexture(posts);
    posts.mipmaps = []; // it is on the card
    this.uniforms.all.editsPosts.value = posts;
    const slots = [...this.slots.values()];
    this.free = Array.from({ length: this.columns ** 2 - slots.length }, (_, k) => this.columns ** 2 - 1 - k);
    slots.forEach((slot, place) => this.upload(slot.square.posts, (slot.place = place)));
  }

  private upload(posts: Int32Array, place: number): void {
    let texels = posts;
    const x = (place % this.columns) * TILE_SIDE, y = Math.floor(place / this.columns) * TILE_SIDE;
    for (let level = 0; level < LEVELS; ++level) {
      const side = TILE_SIDE >> level, from = integers(texels, side);
      this.renderer.copyTextureToTexture(from, this.posts!, null, new Vector2(x >> level, y >> level), 0, level);
      from.dispose();
      const half = side >> 1, next = new Int32Array(half * half);
      for (let j = 0; j < half; ++j)
        for (let i = 0; i < half; ++i) {
          const k = 2 * j * side + 2 * i;
          next[j * half + i] = together([texels[k]!, texels[k + 1]!, texels[k + side]!, texels[k + side + 1]!]);
        }
      texels = next;
    }
  }

  private makeTable(): void {
    const { all } = this.uniforms;
    all.editsHeld.value = this.slots.size;
    all.editsCell.value = [this.cell.x, this.cell.z];
    if (this.slots.size === 0) return;
    if (!this.table) all.editsTable.value = this.table = integers(new Int32Array(TABLE * TABLE), TABLE);
    const entries = this.table.image.data as unknown as Int32Array;
    entries.fill(0);
    const set = (i: number, j: number, entry: number): void => {
      const x = i - this.cell.x * SQUARES, z = j - this.cell.z * SQUARES;
      if (x >= 0 && z >= 0 && x < TABLE && z < TABLE) entries[z * TABLE + x] = entry;
    };
    for (const { square } of this.slots.values()) for (let k = 0; k < 9; ++k) set(square.i + (k % 3) - 1, square.j + Math.floor(k / 3) - 1, -1);
    for (const { square, place } of this.slots.values()) set(square.i, square.j, place + 1);
    this.table.needsUpdate = true;
  }
}
