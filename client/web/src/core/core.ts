// The client's core, compiled from C++ to WebAssembly (wasm/core.cpp): what is said to a server and heard from it, the mesh, the ground
// that edits made. No sockets and no timers. Where its memory ends, its functions throw a WebAssembly.RuntimeError, and it is of no use.

import { ACTS, type Act, type Brush, type Camera, DRIVES, type DrawnLeaf, type Drive, type FromEngine, type LeafAddress, type ToPainterFromEngine } from '../messages';
import type { DracoDecode } from './draco';

/** What a core has others do. */
export interface Owner {
  /** Open a line, to the server of start() or to another (ws://HOST:PORT or wss://...), where the token may not be for all eyes: opened() or closed() follow. */
  dial(elsewhere: string, showsToken: boolean): void;
  send(frame: Uint8Array): void;
  /** End the line, for this is what is wrong: closed() follows, later. */
  hangUp(why: string): void;
  tell(message: FromEngine): void;
  /** taken() follows where the painter takes changes. */
  paint(message: ToPainterFromEngine, transfer: ArrayBuffer[]): void;
}

interface Functions {
  memory: WebAssembly.Memory;
  _initialize(): void;
  room(bytes: number): number;
  dracoRoom(numbers: number): number;
  start(server: number, name: number, threshold: number, random: number): void;
  stop(): void;
  step(now: number): number;
  opened(): void;
  isGreeted(): number;
  comesBack(): number;
  closed(why: number, now: number): void;
  hurry(now: number): void;
  heard(bytes: number, now: number): void;
  pose(x: number, z: number, y: number, yaw: number, pitch: number, fov: number, width: number, height: number, number: number, now: number): void;
  candidates(wanted: number): void;
  threshold(pixels: number): void;
  edit(id: number, operation: number): void;
  setClock(rate: number, time: number, now: number): void;
  drive(drive: number, microseconds: number, now: number): void;
  act(act: number, by: number): void;
  brush(x: number, z: number, y: number, dx: number, dy: number, dz: number, uses: number): void;
  heights(places: number): number;
  taken(): void;
}

const POSTS = 128 * 128; // of a square of edits
const ADDRESS = 24, CHANGED = 64; // bytes of a LeafAddress and of a PointMesh::Changed: level, i and j in eight each; then hash, triangles, low and high
const text = (bytes: Uint8Array): string => new TextDecoder().decode(bytes);
const now = (): number => performance.timeOrigin + performance.now();

type Numbers = Int32Array<ArrayBuffer> | Uint32Array<ArrayBuffer> | Float32Array<ArrayBuffer> | Uint8Array<ArrayBuffer>;

const keyOf = ({ level, i, j }: LeafAddress): string => `${level}/${i}/${j}`;
function addressesOf({ buffer, length }: Uint8Array, size: number): LeafAddress[] {
  const view = new DataView(buffer);
  return Array.from({ length: length / size }, (_, k) => ({ level: view.getInt32(size * k, true), i: Number(view.getBigInt64(size * k + 8, true)), j: Number(view.getBigInt64(size * k + 16, true)) }));
}
function drawnOf(bytes: Uint8Array): DrawnLeaf[] {
  const numbers = new Int32Array(bytes.buffer);
  return addressesOf(bytes, CHANGED).map((address, k) => {
    const corner = (at: number): [number, number, number] => [numbers[at]!, numbers[at + 1]!, numbers[at + 2]!], at = (CHANGED / 4) * k;
    return { key: keyOf(address), address, low: corner(at + 9), high: corner(at + 12) };
  });
}

export class Core {
  private readonly wasm: Functions;

  constructor(
    module: WebAssembly.Module,
    private readonly draco: DracoDecode,
    owner: Owner,
  ) {
    const imports: WebAssembly.ModuleImports = {
      dial: (at: number, bytes: number, showsToken: number) => owner.dial(text(this.bytes(at, bytes)), showsToken !== 0),
      send: (at: number, bytes: number) => owner.send(this.bytes(at, bytes).slice()),
      hangUp: (at: number, bytes: number) => owner.hangUp(text(this.bytes(at, bytes))),
      tell: (at: number, bytes: number) => owner.tell(JSON.parse(text(this.bytes(at, bytes))) as FromEngine),
      paint: (at: number, bytes: number, arrays: number, count: number) => this.paint(owner, JSON.parse(text(this.bytes(at, bytes))) as ToPainterFromEngine, this.arrays(arrays, count)),
      draco: (at: number, bytes: number, triangles: number) => this.decode(this.bytes(at, bytes), triangles),
    };
    const nowhere = (): number => 8; // EBADF: there are no files
    const random_get = (at: number, bytes: number): number => (crypto.getRandomValues(this.bytes(at, bytes)), 0);
    const wasi = { fd_close: nowhere, fd_seek: nowhere, fd_write: nowhere, random_get };
    this.wasm = new WebAssembly.Instance(module, { page: imports, wasi_snapshot_preview1: wasi }).exports as unknown as Functions;
    this.wasm._initialize();
  }

  /** Begins, or begins anew; what is held is resumed. `server`: HOST:PORT, with ws:// or wss:// in front where it matters. */
  start(server: string, name: string, threshold: number): void {
    const sizes = this.give(server, name);
    this.wasm.start(sizes[0]!, sizes[1]!, threshold, Math.random() * 2 ** 32);
  }
  stop(): void {
    this.wasm.stop();
  }
  /** Whatever is to be done; milliseconds until it is to be called again without an event, below 0: never. */
  step(): number {
    return this.wasm.step(now());
  }
  opened(): void {
    this.wasm.opened();
  }
  /** Whether the server has said which world it has, over this line. */
  get isGreeted(): boolean {
    return this.wasm.isGreeted() !== 0;
  }
  /** Whether another attempt is of use. */
  get comesBack(): boolean {
    return this.wasm.comesBack() !== 0;
  }
  closed(why: string): void {
    this.wasm.closed(this.give(why)[0]!, now());
  }
  hurry(): void {
    this.wasm.hurry(now());
  }
  heard(frame: Uint8Array): void {
    this.give(frame);
    this.wasm.heard(frame.length, now());
  }

  pose({ x, z, y, yaw, pitch, verticalFov, width, height }: Camera, number: number): void {
    this.wasm.pose(x, z, y, yaw, pitch, verticalFov, width, height, number, now());
  }
  candidates(wanted: boolean): void {
    this.wasm.candidates(Number(wanted));
  }
  threshold(pixels: number): void {
    this.wasm.threshold(pixels);
  }
  edit(id: number, operation: string): void {
    this.wasm.edit(id, this.give(operation)[0]!);
  }
  setClock(rate: number, time: number): void {
    this.wasm.setClock(rate, time, now());
  }
  drive(drive: Drive, to: number): void {
    this.wasm.drive(DRIVES.indexOf(drive), to, now());
  }
  act(act: Act, by: number): void {
    this.wasm.act(ACTS.indexOf(act), by);
  }
  brush({ from, towards, uses }: Brush): void {
    this.wasm.brush(from.x, from.z, from.y, ...towards, Number(uses));
  }
  /** Metres of the mesh at places, x and z of each in steps; NaN where it has none. */
  heights(places: Float64Array): Float64Array<ArrayBuffer> {
    this.give(new Uint8Array(places.buffer, places.byteOffset, places.byteLength));
    const at = this.wasm.heights(places.length / 2); // before the buffer is looked at: memory may grow
    return new Float64Array(this.wasm.memory.buffer, at, places.length / 2).slice();
  }
  taken(): void {
    this.wasm.taken();
  }

  private bytes(at: number, size: number): Uint8Array {
    return new Uint8Array(this.wasm.memory.buffer, at, size);
  }
  /** Into the room; the size of each. */
  private give(...all: (string | Uint8Array)[]): number[] {
    const parts = all.map((part) => (typeof part === 'string' ? new TextEncoder().encode(part) : part)), sizes = parts.map(({ length }) => length);
    const to = this.bytes(this.wasm.room(sizes.reduce((sum, size) => sum + size, 0)), sizes.reduce((sum, size) => sum + size, 0));
    let at = 0;
    for (const part of parts) to.set(part, at), (at += part.length);
    return sizes;
  }
  private arrays(at: number, count: number): Numbers[] {
    const { buffer } = this.wasm.memory, about = new Uint32Array(buffer, at, 3 * count);
    return Array.from({ length: count }, (_, k) => {
      const kind = [Int32Array, Uint32Array, Float32Array, Uint8Array][about[3 * k]!]!;
      return new kind(buffer, about[3 * k + 1]!, about[3 * k + 2]!).slice();
    });
  }

  private paint(owner: Owner, message: ToPainterFromEngine, arrays: Numbers[]): void {
    if (message.kind === 'change') {
      const [gone, fresh, ends, blocks, changed, corners] = arrays as [Uint8Array, Uint8Array, Uint32Array, Uint32Array, Uint32Array, Int32Array];
      Object.assign(message, { gone: addressesOf(gone, ADDRESS).map(keyOf), fresh: drawnOf(fresh), drawing: { ends, blocks, changed, corners } });
      arrays = arrays.slice(2);
    } else if (message.kind === 'squares') {
      const posts = arrays[0] as Int32Array<ArrayBuffer>;
      message.fresh.forEach((square, k) => (square.posts = posts.slice(k * POSTS, (k + 1) * POSTS)));
      return owner.paint(message, message.fresh.map((square) => square.posts.buffer as ArrayBuffer));
    } else if (message.kind === 'candidates' && message.candidates) {
      Object.assign(message.candidates, { points: arrays[0], errors: arrays[1] });
    }
    owner.paint(message, arrays.map((array) => array.buffer));
  }

  private decode(bytes: Uint8Array, triangles: number): number {
    const made = this.draco(bytes, triangles);
    if (!made) return -1;
    const at = this.wasm.dracoRoom(made.points.length + made.triangles.length), { buffer } = this.wasm.memory;
    new Uint32Array(buffer, at, made.points.length).set(made.points);
    new Uint32Array(buffer, at + 4 * made.points.length, made.triangles.length).set(made.triangles);
    return made.points.length / 3;
  }
}
