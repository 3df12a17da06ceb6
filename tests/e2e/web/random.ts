/** Numbers from `low` to `high`, the same in every run. */
export function randomFrom(seed: number): (low: number, high: number) => number {
  return (low, high) => {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    return low + ((high - low) * seed) / 2 ** 32;
  };
}
