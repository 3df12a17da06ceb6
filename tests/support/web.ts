// What tests of the page's parts need in node.

import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { loadDraco } from '../../client/web/src/core/draco';
import type { Parts } from '../../client/web/src/engine/engine';
import { BLOCK, type DrawnLeaf, type LeafAddress, SLOT, type ToPainterFromEngine } from '../../client/web/src/messages';

const folder = process.env['RIDGECAST_WEB']!; // client/web

export async function parts(): Promise<Parts> {
  const require = createRequire(join(folder, 'package.json'));
  const draco = readFileSync(require.resolve('draco3d/draco_decoder.wasm')), core = readFileSync(join(folder, 'src/generated/core.wasm'));
  return { draco: await loadDraco(require('draco3d/draco_decoder_nodejs.js'), Uint8Array.from(draco).buffer), core: new WebAssembly.Module(core) };
}

/** What somebody draws who keeps a copy of the slots, as the painter does. */
export class Copy {
  readonly leaves = new Map<string, { leaf: DrawnLeaf; blocks: Uint32Array }>();
  private readonly slots = new Map<number, Int32Array>();
  private readonly hashes = new Map<string, bigint>(); // of leaves that are as when they were hashed

  apply({ gone, fresh, drawing, clear }: Extract<ToPainterFromEngine, { kind: 'change' }>): void {
    if (clear) this.leaves.clear();
    for (const key of gone) this.leaves.delete(key);
    const { ends, blocks, changed, corners } = drawing, touched = new Set([...changed].map((slot) => Math.floor(slot / BLOCK)));
    changed.forEach((slot, k) => this.slots.set(slot, corners.slice(SLOT * k, SLOT * (k + 1))));
    fresh.forEach((leaf, k) => this.leaves.set(leaf.key, { leaf, blocks: blocks.slice(k === 0 ? 0 : ends[k - 1], ends[k]) }));
    for (const { key } of fresh) this.hashes.delete(key);
    for (const key of this.hashes.keys()) if (!this.leaves.get(key)?.blocks.every((block) => !touched.has(block))) this.hashes.delete(key);
  }

  /** Corners of a leaf's triangles: x, z, y of each, steps from its own. */
  trianglesOf(key: string): Int32Array[] {
    return [...this.leaves.get(key)!.blocks].flatMap((block) => Array.from({ length: BLOCK }, (_, k) => this.slots.get(BLOCK * block + k)!).filter((corners) => corners.some((v) => v !== 0)));
  }
  get triangles(): number {
    return [...this.leaves.keys()].reduce((sum, key) => sum + this.trianglesOf(key).length, 0);
  }

  /** Of the whole mesh, by PROTOCOL.md alone. Throws where a block is drawn for two leaves, or a triangle lies beyond its leaf's bounds. */
  get hash(): bigint {
    const owned = [...this.leaves.values()].flatMap(({ blocks }) => [...blocks]);
    if (new Set(owned).size !== owned.length) throw new Error('two leaves have a block');
    for (const [key, { leaf }] of this.leaves) {
      if (this.hashes.has(key)) continue;
      const triangles = this.trianglesOf(key);
      for (const corners of triangles)
        if (corners.some((v, k) => v < leaf.low[k % 3]! || v > leaf.high[k % 3]!)) throw new Error(`leaf ${key} has a triangle beyond its bounds`);
      this.hashes.set(key, hashTerm(leaf.address, hashLeaf(leaf.address, triangles)));
    }
    return whole([...this.hashes.values()].reduce((sum, term) => sum + term, 0n));
  }
}

// ---- hashes, by PROTOCOL.md alone ----

const whole = (v: number | bigint): bigint => BigInt.asUintN(64, BigInt(v));

export function mix(v: bigint): bigint {
  v = whole(v + 0x9e3779b97f4a7c15n);
  v = whole((v ^ (v >> 30n)) * 0xbf58476d1ce4e5b9n);
  v = whole((v ^ (v >> 27n)) * 0x94d049bb133111ebn);
  return v ^ (v >> 31n);
}
const chain = (...values: bigint[]): bigint => values.reduceRight((sum, v) => mix(whole(v + sum)), 0n);

export const hashVertex = (x: number, z: number, y: number): bigint => chain(whole(x), whole(z), whole(y));

export function hashLeaf({ level, i, j }: LeafAddress, triangles: readonly Int32Array[]): bigint {
  const side = 2 ** (13 + level);
  let sum = 0n;
  for (const t of triangles) {
    const corners = [0, 3, 6].map((k): [number, number, number] => [i * side + t[k]!, j * side + t[k + 1]!, t[k + 2]!]);
    while (corners.some(([x, z]) => x < corners[0]![0] || (x === corners[0]![0] && z < corners[0]![1]))) corners.push(corners.shift()!);
    sum += chain(...corners.map((c) => hashVertex(...c)));
  }
  return whole(sum);
}

export const hashTerm = ({ level, i, j }: LeafAddress, leafHash: bigint): bigint => mix(whole(leafHash + chain(whole(level), whole(i), whole(j))));
