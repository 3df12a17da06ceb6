// Working memory is kept from one delta to the next: most deltas are small, and zeroed arrays would cost more than decoding. It grows
// to what the largest leaf needs, and nothing in it is valid after the call. One thread.
const kept: Uint32Array[] = [];
const keptBytes: Uint8Array[] = [];
export function words(slot: number, count: number): Uint32Array {
  let array = kept[slot];
  if (!array || array.length < count) array = kept[slot] = new Uint32Array(Math.max(1024, 2 * count));
  return array;
}
export function bytes(slot: number, count: number): Uint8Array {
  let array = keptBytes[slot];
  if (!array || array.length < count) array = keptBytes[slot] = new Uint8Array(Math.max(1024, 2 * count));
  return array;
}
export function signed(slot: number, count: number): Int32Array {
  const array = words(slot, count);
  return new Int32Array(array.buffer, 0, array.length);
}
