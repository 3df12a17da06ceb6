// The mesh as an array of triangles for a graphics card, of which an iteration changes little.

import { BLOCK, type DrawnLeaf, SLOT } from '../src/messages';
import { type Change, STEPS_PER_METRE } from './client';

/** Numbers of the array: from, and how many. */
export type Range = readonly [start: number, count: number];

export class Triangles {
  /** x, y, z of three corners of each, metres from the origin; nine equal numbers where there is no triangle. Replaced when it grows. */
  positions = new Float32Array(0);
  private readonly leaves = new Map<string, { leaf: DrawnLeaf; blocks: Uint32Array }>();
  private readonly owners = new Map<number, DrawnLeaf>(); // of blocks

  /** Where positions are counted from, metres: near the camera, for they have 24 bits. */
  constructor(private readonly origin: { x: number; z: number }) {}

  /** What has changed of the positions; all of them where they were replaced. */
  apply({ gone, fresh, drawing, clear }: Change): Range[] {
    const { ends, blocks, changed, corners } = drawing, free = new Set<number>(), ranges: Range[] = [];
    const leave = (key: string): void => {
      for (const block of this.leaves.get(key)?.blocks ?? []) if (this.owners.get(block)?.key === key) free.add(block), this.owners.delete(block);
      this.leaves.delete(key);
    };
    if (clear) for (const key of [...this.leaves.keys()]) leave(key);
    gone.forEach(leave);
    for (const { key } of fresh) leave(key);
    fresh.forEach((leaf, k) => {
      const own = blocks.slice(k === 0 ? 0 : ends[k - 1], ends[k]);
      for (const block of own) this.owners.set(block, leaf), free.delete(block);
      this.leaves.set(leaf.key, { leaf, blocks: own });
    });
    const isNew = this.grow(blocks.reduce((most, block) => Math.max(most, block + 1), 0));
    for (const block of free) this.positions.fill(0, SLOT * BLOCK * block, SLOT * BLOCK * (block + 1)), ranges.push([SLOT * BLOCK * block, SLOT * BLOCK]);
    for (let k = 0; k < changed.length; ++k) {
      const slot = changed[k]!, { level, i, j } = this.owners.get(Math.floor(slot / BLOCK))!.address, side = 2 ** (13 + level);
      const there = corners.subarray(SLOT * k, SLOT * (k + 1)), isTriangle = there.some((v) => v !== 0);
      for (let c = 0; c < SLOT; c += 3) {
        this.positions[SLOT * slot + c] = isTriangle ? (i * side + there[c]!) / STEPS_PER_METRE - this.origin.x : 0;
        this.positions[SLOT * slot + c + 1] = isTriangle ? there[c + 2]! / STEPS_PER_METRE : 0;
        this.positions[SLOT * slot + c + 2] = isTriangle ? (j * side + there[c + 1]!) / STEPS_PER_METRE - this.origin.z : 0;
      }
      const last = ranges.at(-1), start = SLOT * slot;
      if (last && last[0] + last[1] === start) ranges[ranges.length - 1] = [last[0], last[1] + SLOT];
      else ranges.push([start, SLOT]);
    }
    return isNew ? [[0, this.positions.length]] : ranges;
  }

  /** Whether it did. */
  private grow(blocks: number): boolean {
    const most = this.positions.length / (SLOT * BLOCK);
    if (blocks <= most) return false;
    const before = this.positions;
    this.positions = new Float32Array(SLOT * BLOCK * Math.max(1024, blocks, 2 * most));
    this.positions.set(before);
    return true;
  }
}
