// Reads bytes and varints of at most five bytes (PROTOCOL.md, Leaf payload). Throws Refusal at the end of what there is.

import { Refusal } from './mesh';

export class Reader {
  private at = 0;
  constructor(private readonly bytes: Uint8Array) {}
  byte(): number {
    if (this.at >= this.bytes.length) throw new Refusal('it ends too early');
    return this.bytes[this.at++]!;
  }
  varint(): number {
    let value = 0;
    for (let k = 0, scale = 1; k < 5; ++k, scale *= 128) {
      const b = this.byte();
      value += (b & 0x7f) * scale;
      if (b < 0x80) return value;
    }
    throw new Refusal('a number has more than five bytes');
  }
  zigzag(): number {
    const v = this.varint();
    return v % 2 === 0 ? v / 2 : -(v + 1) / 2;
  }
  rest(): Uint8Array {
    return this.bytes.subarray(this.at);
  }
}
