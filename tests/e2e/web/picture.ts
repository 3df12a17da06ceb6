// Pictures as the tests need them: PNG to luma, and how alike two are.

import { inflateSync } from 'node:zlib';

export interface Picture {
  width: number;
  height: number;
  rgb: Uint8Array;
}

/** 8 bits a channel, colour with or without alpha, not interlaced: what browsers and the client write. */
export function decodePng(png: Buffer): Picture {
  const width = png.readUInt32BE(16), height = png.readUInt32BE(20);
  const channels = png[25] === 6 ? 4 : png[25] === 2 ? 3 : 0;
  if (png.toString('latin1', 1, 4) !== 'PNG' || png[24] !== 8 || channels === 0 || png[28] !== 0) throw new Error('not a PNG of the kind that is expected');
  const parts: Buffer[] = [];
  for (let at = 8; at < png.length; at += 12 + png.readUInt32BE(at)) if (png.toString('latin1', at + 4, at + 8) === 'IDAT') parts.push(png.subarray(at + 8, at + 8 + png.readUInt32BE(at)));
  const raw = inflateSync(Buffer.concat(parts)), stride = width * channels;
  const rows = new Uint8Array(stride * height);
  for (let y = 0; y < height; ++y) {
    const filter = raw[y * (stride + 1)]!;
    for (let x = 0; x < stride; ++x) {
      const a = x >= channels ? rows[y * stride + x - channels]! : 0, b = y > 0 ? rows[(y - 1) * stride + x]! : 0;
      const c = x >= channels && y > 0 ? rows[(y - 1) * stride + x - channels]! : 0;
      const p = a + b - c, pa = Math.abs(p - a), pb = Math.abs(p - b), pc = Math.abs(p - c);
      const guess = [0, a, b, (a + b) >> 1, pa <= pb && pa <= pc ? a : pb <= pc ? b : c][filter]!;
      rows[y * stride + x] = raw[y * (stride + 1) + 1 + x]! + guess;
    }
  }
  const rgb = new Uint8Array(width * height * 3);
  for (let k = 0; k < width * height; ++k) for (let c = 0; c < 3; ++c) rgb[3 * k + c] = rows[channels * k + c]!;
  return { width, height, rgb };
}

function luma(p: Picture): Float64Array {
  return Float64Array.from({ length: p.width * p.height }, (_, k) => 0.299 * p.rgb[3 * k]! + 0.587 * p.rgb[3 * k + 1]! + 0.114 * p.rgb[3 * k + 2]!);
}

/** Standard deviation of the luma: a flat picture has none. */
export function contrast(p: Picture): number {
  const l = luma(p), mean = l.reduce((a, b) => a + b, 0) / l.length;
  return Math.sqrt(l.reduce((sum, v) => sum + (v - mean) ** 2, 0) / l.length);
}

/** Mean SSIM of the luma (Wang 2004): 11 x 11 Gaussian windows, sigma 1.5, those that fit. */
export function ssim(p: Picture, q: Picture): number {
  if (p.width !== q.width || p.height !== q.height) throw new Error(`${p.width}x${p.height} against ${q.width}x${q.height}`);
  const { width, height } = p, w = width - 10, h = height - 10;
  const kernel = Array.from({ length: 11 }, (_, k) => Math.exp(-((k - 5) ** 2) / 4.5));
  const total = kernel.reduce((a, b) => a + b, 0);
  const blurred = (f: (k: number) => number): Float64Array => {
    const rows = new Float64Array(w * height), out = new Float64Array(w * h);
    for (let y = 0; y < height; ++y) for (let x = 0; x < w; ++x) for (let k = 0; k < 11; ++k) rows[y * w + x]! += (kernel[k]! / total) * f(y * width + x + k);
    for (let y = 0; y < h; ++y) for (let x = 0; x < w; ++x) for (let k = 0; k < 11; ++k) out[y * w + x]! += (kernel[k]! / total) * rows[(y + k) * w + x]!;
    return out;
  };
  const a = luma(p), b = luma(q);
  const ma = blurred((k) => a[k]!), mb = blurred((k) => b[k]!), aa = blurred((k) => a[k]! ** 2), bb = blurred((k) => b[k]! ** 2), ab = blurred((k) => a[k]! * b[k]!);
  const c1 = (0.01 * 255) ** 2, c2 = (0.03 * 255) ** 2;
  let sum = 0;
  for (let k = 0; k < ma.length; ++k) {
    const m = ma[k]! * mb[k]!, va = aa[k]! - ma[k]! ** 2, vb = bb[k]! - mb[k]! ** 2;
    sum += ((2 * m + c1) * (2 * (ab[k]! - m) + c2)) / ((ma[k]! ** 2 + mb[k]! ** 2 + c1) * (va + vb + c2));
  }
  return sum / ma.length;
}
