// A whole leaf's payload -> its mesh. PROTOCOL.md, Leaf payload.

import { LeafAddress, LeafMesh, MAX_HEIGHT, MAX_OFFSET, MAX_TRIANGLES, Refusal, canonical } from './mesh';
import { Reader } from './reader';

/** Draco's share: faces and the integer attribute of a stream, which must have exactly `triangles` faces. Throws Refusal. */
export type DracoDecode = (bytes: Uint8Array, triangles: number) => { points: Int32Array; triangles: Uint32Array };

const PLAIN = 0x10, DRACO = 0x11;
const MAX_PAYLOAD = 64 * 2 ** 20;
// Magic, bitstream 2.2, triangular mesh, edgebreaker, no flags, standard traversal.
const DRACO_START = [0x44, 0x52, 0x41, 0x43, 0x4f, 2, 2, 1, 1, 0, 0, 0];

function decodePlain(bytes: Uint8Array, vertices: number, triangles: number): { points: Int32Array; triangles: Uint32Array } {
  if (bytes.length < 3 * (vertices + triangles)) throw new Refusal('it is too short for its counts');
  const reader = new Reader(bytes);
  const points = new Int32Array(3 * vertices), faces = new Uint32Array(3 * triangles);
  let x = 0, z = 0, y = 0;
  for (let v = 0; v < points.length; v += 3) {
    x += reader.varint();
    z += reader.zigzag();
    y += reader.zigzag();
    if (x > 2 ** 28 || z < 0 || z > 2 ** 28 || y < 0 || y > 2 ** 28) throw new Refusal('a vertex is out of range');
    points[v] = x, points[v + 1] = z, points[v + 2] = y;
  }
  let a = 0;
  for (let k = 0; k < faces.length; k += 3) {
    a += reader.varint();
    const b = a + 1 + reader.varint(), c = a + 1 + reader.varint();
    if (a >= vertices || b >= vertices || c >= vertices) throw new Refusal('a triangle names a vertex that is not there');
    faces[k] = a, faces[k + 1] = b, faces[k + 2] = c;
  }
  if (reader.rest().length > 0) throw new Refusal('it has bytes after its end');
  return { points, triangles: faces };
}

function checkDraco(bytes: Uint8Array, triangles: number): void {
  if (bytes.length < DRACO_START.length || DRACO_START.some((b, k) => bytes[k] !== b))
    throw new Refusal('its Draco stream is not of the one kind that is used');
  const reader = new Reader(bytes.subarray(DRACO_START.length));
  const vertices = reader.varint(), faces = reader.varint(), moreAttributes = reader.byte(), symbols = reader.varint(), splits = reader.varint();
  if (faces !== triangles || vertices > 3 * faces || moreAttributes !== 0 || symbols > faces || splits > symbols)
    throw new Refusal('its Draco stream does not have the announced counts');
  if (faces > 8 * bytes.length) throw new Refusal('its Draco stream is too short for its counts');
}

/** `vertices` and `triangles` are the announced counts. Throws Refusal. */
export function decodeLeaf(payload: Uint8Array, address: LeafAddress, vertices: number, triangles: number, draco: DracoDecode): LeafMesh {
  if (vertices === 0 && triangles === 0) {
    if (payload.length > 0) throw new Refusal('its payload should be empty like the leaf');
    return { address, vertices: new Int32Array(0), triangles: new Uint32Array(0) };
  }
  if (vertices < 3 || vertices > 3 * triangles || triangles > MAX_TRIANGLES) throw new Refusal('its counts contradict each other');
  if (payload.length > MAX_PAYLOAD || payload.length > 256 + 64 * triangles) throw new Refusal('its payload is too long for its counts');
  const reader = new Reader(payload);
  const form = reader.byte();
  if (form !== PLAIN && form !== DRACO) throw new Refusal('the form of its payload is unknown');
  const shifts = reader.byte() | (reader.byte() << 8);
  const shift = [shifts & 31, (shifts >> 5) & 31, (shifts >> 10) & 31];
  if (shifts > 0x7fff || shift.some((s) => s > 28)) throw new Refusal('its shifts are out of range');
  const least = [reader.zigzag(), reader.zigzag(), reader.zigzag()];
  const body = reader.rest();
  if (form === DRACO) checkDraco(body, triangles);
  const soup = form === PLAIN ? decodePlain(body, vertices, triangles) : draco(body, triangles);
  const points = soup.points;
  for (let k = 0; k < points.length; ++k) {
    const c = k % 3, value = least[c]! + points[k]! * 2 ** shift[c]!;
    if (points[k]! < 0 || Math.abs(value) > (c === 2 ? MAX_HEIGHT : MAX_OFFSET)) throw new Refusal('a vertex is out of range');
    points[k] = value;
  }
  const leaf = canonical(address, points, soup.triangles);
  if (leaf.vertices.length !== 3 * vertices || leaf.triangles.length !== 3 * triangles) throw new Refusal('it does not have the announced counts');
  return leaf;
}
