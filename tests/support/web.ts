// What tests of the page's parts need in node.

import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { loadDraco } from '../../client/web/src/codec/draco';
import { LeafAddress, LeafMesh, cornerX, cornerZ } from '../../client/web/src/codec/mesh';
import type { Parts } from '../../client/web/src/engine/engine';

const folder = process.env['RIDGECAST_WEB']!; // client/web

export const pointsModule = (): WebAssembly.Module => new WebAssembly.Module(readFileSync(join(folder, 'src/generated/point_mesh.wasm')));

export async function parts(): Promise<Parts> {
  const require = createRequire(join(folder, 'package.json'));
  const wasm = readFileSync(require.resolve('draco3d/draco_decoder.wasm'));
  return { draco: await loadDraco(require('draco3d/draco_decoder_nodejs.js'), Uint8Array.from(wasm).buffer), points: pointsModule() };
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

export function hashLeaf({ address, vertices, triangles }: LeafMesh): bigint {
  const corner = (k: number): [number, number, number] => {
    const v = 3 * triangles[k]!;
    return [cornerX(address) + vertices[v]!, cornerZ(address) + vertices[v + 1]!, vertices[v + 2]!];
  };
  let sum = 0n;
  for (let k = 0; k < triangles.length; k += 3) {
    const corners = [corner(k), corner(k + 1), corner(k + 2)];
    while (corners.some(([x, z]) => x < corners[0]![0] || (x === corners[0]![0] && z < corners[0]![1]))) corners.push(corners.shift()!);
    sum += chain(...corners.map((c) => hashVertex(...c)));
  }
  return whole(sum);
}

export const hashTerm = ({ level, i, j }: LeafAddress, leafHash: bigint): bigint => mix(whole(leafHash + chain(whole(level), whole(i), whole(j))));
