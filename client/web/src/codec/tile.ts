// 128 x 128 samples, along x first (PROTOCOL.md, Tile payload).

import { Refusal } from './mesh';
import { Reader } from './reader';

export const TILE_SIDE = 128;

/** Throws Refusal where these are not the bytes of a tile with numbers from `least` to `most`. */
export function decodeTile(bytes: Uint8Array, least: number, most: number): Int32Array {
  const reader = new Reader(bytes), out = new Int32Array(TILE_SIDE * TILE_SIDE);
  if (reader.byte() !== 0x30) throw new Refusal('a tile has a form that is not known');
  let zeros = 0;
  for (let k = 0; k < out.length; ++k) {
    let difference = 0;
    if (zeros > 0) --zeros;
    else if ((difference = reader.zigzag()) === 0) zeros = reader.varint();
    const x = k % TILE_SIDE, left = x > 0 ? out[k - 1]! : 0, above = k >= TILE_SIDE ? out[k - TILE_SIDE]! : 0;
    const guess = left + above - (x > 0 && k >= TILE_SIDE ? out[k - TILE_SIDE - 1]! : 0), value = guess + difference;
    if (value < least || value > most) throw new Refusal('a tile has a number beyond its range');
    out[k] = value;
  }
  if (zeros > 0 || reader.rest().length > 0) throw new Refusal('a tile is longer than a tile');
  return out;
}
