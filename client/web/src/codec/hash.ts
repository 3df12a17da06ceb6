// 64-bit arithmetic that wraps, in two 32-bit halves: BigInt would be twenty times slower. PROTOCOL.md, Hash.

/** A 64-bit number that is added to in place. */
export class Sum {
  hi = 0;
  lo = 0;
  constructor(hi = 0, lo = 0) {
    this.hi = hi | 0;
    this.lo = lo | 0;
  }
  static of(value: bigint): Sum {
    return new Sum(Number(BigInt.asIntN(32, value >> 32n)), Number(BigInt.asIntN(32, value)));
  }
  add(hi: number, lo: number): void {
    const l = (this.lo >>> 0) + (lo >>> 0);
    this.lo = l | 0;
    this.hi = (this.hi + hi + (l > 0xffffffff ? 1 : 0)) | 0;
  }
  subtract(hi: number, lo: number): void {
    const l = (this.lo >>> 0) - (lo >>> 0);
    this.lo = l | 0;
    this.hi = (this.hi - hi - (l < 0 ? 1 : 0)) | 0;
  }
  get value(): bigint {
    return (BigInt(this.hi >>> 0) << 32n) | BigInt(this.lo >>> 0);
  }
}

/** The halves of the last result of mix and what is built on it. */
export const out = new Int32Array(2);

/** The upper half of a whole number, |v| < 2^53, as two's complement. */
function upper(v: number): number {
  return Math.floor(v / 2 ** 32) | 0;
}

function multiplied(h: number, l: number, ch: number, cl: number): void {
  const a = l >>> 16, b = l & 0xffff, c = cl >>> 16, d = cl & 0xffff;
  const ad = a * d, bc = b * c;
  const middle = ((b * d) >>> 16) + (ad & 0xffff) + (bc & 0xffff);
  out[0] = (a * c + (ad >>> 16) + (bc >>> 16) + (middle >>> 16) + Math.imul(h, cl) + Math.imul(l, ch)) | 0;
  out[1] = Math.imul(l, cl);
}

/** SplitMix64's finaliser; the result is in `out`. */
export function mix(hi: number, lo: number): void {
  const sum = (lo >>> 0) + 0x7f4a7c15;
  let h = (hi + 0x9e3779b9 + (sum > 0xffffffff ? 1 : 0)) | 0;
  let l = sum | 0;
  multiplied(h ^ (h >>> 30), l ^ ((l >>> 30) | (h << 2)), 0xbf58476d, 0x1ce4e5b9);
  h = out[0]!;
  l = out[1]!;
  multiplied(h ^ (h >>> 27), l ^ ((l >>> 27) | (h << 5)), 0x94d049bb, 0x133111eb);
  h = out[0]!;
  l = out[1]!;
  out[0] = h ^ (h >>> 31);
  out[1] = l ^ ((l >>> 31) | (h << 1));
}

function mixSum(hi: number, lo: number): void {
  const sum = (lo >>> 0) + (out[1]! >>> 0);
  mix((hi + out[0]! + (sum > 0xffffffff ? 1 : 0)) | 0, sum | 0);
}

/** mix(v + what `out` holds), v whole. */
export function mixAdded(v: number): void {
  mixSum(upper(v), v | 0);
}

/** A vertex's hash from its whole lattice position. */
export function hashVertex(x: number, z: number, y: number): void {
  mix(upper(y), y | 0);
  mixAdded(z);
  mixAdded(x);
}

/** A triangle's hash from those of its vertices, at these places of `hashes` (two halves each), the smallest by x, then z, first. */
export function hashTriangle(hashes: Int32Array, a: number, b: number, c: number): void {
  mix(hashes[2 * c]!, hashes[2 * c + 1]!);
  mixSum(hashes[2 * b]!, hashes[2 * b + 1]!);
  mixSum(hashes[2 * a]!, hashes[2 * a + 1]!);
}
