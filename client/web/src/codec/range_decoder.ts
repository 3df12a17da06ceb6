// Binary arithmetic decoding with adaptive probabilities. PROTOCOL.md, Delta payload, Arithmetic coding.

const RATE = Uint16Array.of(32768, 21845, 16384, 13107, 10922, 9362, 8192, 7281, 6553, 5957, 5461, 5041, 4681, 4369, 4096, 3855, 3640, 3449, 3276);
const TOP = 0x80000000 | 0; // turns an unsigned comparison into a signed one
const LOW = 0, HIGH = 1, VALUE = 2;

/** Contexts, named by whoever uses them: each a probability of 1 and how many bits it has seen. */
export class Contexts {
  readonly one: Uint16Array;
  readonly seen: Uint8Array;
  constructor(count: number) {
    this.one = new Uint16Array(count).fill(32768);
    this.seen = new Uint8Array(count);
  }
}

/** How many bytes it takes to name a number in [low, high] whose lower bytes are 0. */
function tailBytes(low: number, high: number): number {
  for (let bytes = 0; bytes < 4; ++bytes) {
    const unit = 2 ** (32 - 8 * bytes);
    if (Math.ceil(low / unit) * unit <= high) return bytes;
  }
  return 4;
}

export class RangeDecoder {
  private readonly state = new Int32Array(3);
  private at = 0;
  constructor(
    private readonly bytes: Uint8Array,
    private readonly contexts: Contexts,
  ) {
    this.state[HIGH] = -1;
    for (let k = 0; k < 4; ++k) this.state[VALUE] = (this.state[VALUE]! << 8) | this.next();
  }

  bit(context: number): boolean {
    const s = this.state, c = this.contexts;
    const one = c.one[context]!, seen = c.seen[context]!;
    const low = s[LOW]!;
    const is = this.split((low + Math.imul((s[HIGH]! - low) >>> 16, one)) | 0);
    // |target - one| x rate is below 2^31; the shift rounds down.
    c.one[context] = one + ((((is ? 65471 : 64) - one) * RATE[seen]!) >> 16);
    if (seen < 18) c.seen[context] = seen + 1;
    return is;
  }

  even(): boolean {
    const low = this.state[LOW]!;
    return this.split((low + ((this.state[HIGH]! - low) >>> 1)) | 0);
  }

  /** More was read than an encoder can have left out. */
  get failed(): boolean {
    return this.at > this.bytes.length + 4;
  }
  /** Exactly as many bytes were there as the content needs. */
  get finished(): boolean {
    return this.bytes.length + 4 === this.at + tailBytes(this.state[LOW]! >>> 0, this.state[HIGH]! >>> 0);
  }

  private next(): number {
    return this.at < this.bytes.length ? this.bytes[this.at++]! : (++this.at, 0);
  }

  private split(middle: number): boolean {
    const s = this.state;
    const is = (s[VALUE]! ^ TOP) <= (middle ^ TOP);
    if (is) s[HIGH] = middle;
    else s[LOW] = middle + 1;
    while ((s[LOW]! ^ s[HIGH]!) >>> 24 === 0) {
      s[LOW] = s[LOW]! << 8;
      s[HIGH] = (s[HIGH]! << 8) | 255;
      s[VALUE] = (s[VALUE]! << 8) | this.next();
    }
    return is;
  }
}
