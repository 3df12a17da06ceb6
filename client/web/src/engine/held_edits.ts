// What edits have made of the ground around the camera, as far as the page has it: squares of posts, fetched nearest first, and again when
// an edit has changed them. As client/scene/held_edits.h; the posts themselves go to the painter. At most MOST_HELD squares: ground beyond
// them is the terrain's own here, though the mesh knows better.

import { Refusal } from '../codec/mesh';
import { TILE_SIDE, decodeTile } from '../codec/tile';
import type { FoundEdits, Squares } from '../generated/ridgecast/v1/stream_pb';
import type { EditSquare } from '../messages';

export const MOST_HELD = 1024;
const MOST_PENDING = 64;
const MOST_FOUND = 4096; // squares of a FoundEdits
const MOST_NAMED = 1024; // squares of a changed area; more are looked for
const SLACK = 1500 * 256; // steps that the camera may move before squares are looked for again
const SIDE = TILE_SIDE * 128; // steps
const OUTDATED = -1n; // good as of no edit
const MOST_RISE = 2 ** 20, MATERIALS = 8;

interface Known {
  i: number;
  j: number;
  needs: bigint; // good as of this edit
  held: bigint | undefined; // is good as of this one
}

export interface Find {
  x: number; // steps
  z: number;
  radius: number; // metres; 0: no squares are to be named
  since: bigint;
}

const keyOf = (i: number, j: number): string => `${i},${j}`;
const isGood = ({ held, needs }: Known): boolean => held !== undefined && held >= needs;

export class HeldEdits {
  private readonly reach: number; // steps
  private camera = { x: 0, z: 0 };
  private foundAt: { x: number; z: number } | undefined;
  private finding = false;
  private named = false; // the pending question asks for squares
  private last = 0n; // of the session
  private edit = 0n; // changes up to this one are known here
  private readonly known = new Map<string, Known>();
  private nearest: Known[] = [];
  private sorted = true;
  private readonly pending = new Set<string>();
  private fresh = new Map<string, EditSquare>(); // since changes()
  private gone = new Set<string>();

  constructor(horizon: number) {
    this.reach = horizon * 256;
  }

  moveTo(x: number, z: number): void {
    const { camera, foundAt } = this;
    if (Math.floor(x / SIDE) !== Math.floor(camera.x / SIDE) || Math.floor(z / SIDE) !== Math.floor(camera.z / SIDE)) this.sorted = false;
    this.camera = { x, z };
    if (foundAt && Math.hypot(x - foundAt.x, z - foundAt.z) > SLACK) this.foundAt = undefined;
  }

  /** On another connection to the session, whose last edit is this: everything is fetched again, for its edits may have ended with it and
   *  begun anew. What is held stays until then. */
  reconnected(edit: bigint): void {
    this.pending.clear();
    this.finding = this.named = false;
    this.foundAt = undefined;
    this.last = edit;
    this.edit = 0n;
    for (const [key, known] of [...this.known]) {
      known.needs = 0n;
      if (known.held !== undefined) known.held = OUTDATED;
      if (edit === 0n) this.drop(key);
    }
  }

  /** The session has this edit. */
  know(edit: bigint): void {
    if (edit > this.last) this.last = edit;
  }

  /** What to ask now. */
  take(): { find: Find | undefined; want: { i: bigint; j: bigint }[] } {
    const want: { i: bigint; j: bigint }[] = [];
    let find: Find | undefined;
    if (this.last === 0n) return { find, want };
    if (!this.finding && (!this.foundAt || this.edit < this.last)) {
      this.finding = true;
      this.named = !this.foundAt;
      if (this.named) this.foundAt = this.camera;
      find = { ...this.camera, radius: this.named ? (this.reach + SLACK) / 256 : 0, since: this.edit };
    }
    this.sort();
    for (const known of this.nearest) {
      const key = keyOf(known.i, known.j);
      if (this.pending.size >= MOST_PENDING) break;
      if (this.known.get(key) !== known || isGood(known) || this.pending.has(key)) continue;
      this.pending.add(key);
      want.push({ i: BigInt(known.i), j: BigInt(known.j) });
    }
    return { find, want };
  }

  found({ edit, changed, squares }: FoundEdits): void {
    if (!this.finding) throw new Refusal('where edits are, without being asked');
    this.finding = false;
    if (edit > this.edit) this.edit = edit;
    this.know(edit);
    const { named } = this;
    if (named) {
      const there = new Set(squares.map(({ i, j }) => keyOf(Number(i), Number(j))));
      for (const key of [...this.known.keys()]) if (!there.has(key)) this.drop(key);
      for (const { i, j } of squares) this.add(Number(i), Number(j), 0n);
    }
    this.named = false;
    for (const area of changed) this.changed(Number(area.x0), Number(area.z0), Number(area.x1), Number(area.z1), edit, named);
  }

  put({ edit, squares }: Squares): void {
    for (const { address, rises, materials } of squares) {
      const i = Number(address?.i ?? 0n), j = Number(address?.j ?? 0n), key = keyOf(i, j);
      if (!this.pending.delete(key)) throw new Refusal('a square of edits that was not requested');
      const posts = postsOf(rises, materials), known = this.known.get(key);
      if (!known) continue;
      if (!posts && edit >= known.needs) {
        this.drop(key);
        continue;
      }
      known.held = edit;
      if (!posts) this.lose(key);
      else this.fresh.set(key, { key, i, j, ...posts });
    }
  }

  /** What has come and gone since the last call. */
  changes(): { fresh: EditSquare[]; gone: string[] } {
    const out = { fresh: [...this.fresh.values()], gone: [...this.gone] };
    this.fresh.clear();
    this.gone.clear();
    return out;
  }
  /** Squares that are held. */
  get all(): string[] {
    return [...this.known].filter(([, { held }]) => held !== undefined).map(([key]) => key);
  }

  /** Everything around the camera is held, as of the last edit that is known. */
  get complete(): boolean {
    if (this.last === 0n) return true;
    if (this.finding || !this.foundAt || this.edit < this.last || !this.sorted || this.pending.size > 0) return false;
    return this.nearest.every((known) => this.known.get(keyOf(known.i, known.j)) !== known || isGood(known));
  }

  private add(i: number, j: number, needs: bigint): void {
    const key = keyOf(i, j);
    if (this.known.has(key)) return;
    this.known.set(key, { i, j, needs, held: undefined });
    this.sorted = false;
  }

  private drop(key: string): void {
    this.known.delete(key);
    this.sorted = false;
    this.lose(key);
  }
  private lose(key: string): void {
    this.fresh.delete(key);
    this.gone.add(key);
  }

  private changed(x0: number, z0: number, x1: number, z1: number, edit: bigint, named: boolean): void {
    for (const known of this.known.values())
      if (known.i * SIDE < x1 && x0 < (known.i + 1) * SIDE && known.j * SIDE < z1 && z0 < (known.j + 1) * SIDE) known.needs = edit;
    if (named) return;
    const { camera } = this, reach = this.reach + SLACK;
    const i0 = Math.floor(Math.max(x0, camera.x - reach) / SIDE), i1 = Math.floor(Math.min(x1 - 1, camera.x + reach) / SIDE);
    const j0 = Math.floor(Math.max(z0, camera.z - reach) / SIDE), j1 = Math.floor(Math.min(z1 - 1, camera.z + reach) / SIDE);
    if (i1 < i0 || j1 < j0) return;
    if ((i1 - i0 + 1) * (j1 - j0 + 1) > MOST_NAMED || this.known.size > MOST_FOUND) return void (this.foundAt = undefined);
    for (let j = j0; j <= j1; ++j) for (let i = i0; i <= i1; ++i) this.add(i, j, edit);
  }

  /** Those to be held, the nearest first; what is held of others goes. */
  private sort(): void {
    if (this.sorted) return;
    const away = ({ i, j }: Known): number => Math.hypot((i + 0.5) * SIDE - this.camera.x, (j + 0.5) * SIDE - this.camera.z);
    const all = [...this.known.values()].map((known) => ({ known, away: away(known) })).sort((a, b) => a.away - b.away);
    this.nearest = all.slice(0, MOST_HELD).map(({ known }) => known);
    for (const { known } of all.slice(MOST_HELD)) {
      if (known.held !== undefined) this.lose(keyOf(known.i, known.j));
      known.held = undefined;
    }
    this.sorted = true;
  }
}

/** As edited.glsl takes them, and between which steps they are raised; nothing: all are 0. */
function postsOf(rises: Uint8Array, materials: Uint8Array): Pick<EditSquare, 'posts' | 'lowest' | 'highest'> | undefined {
  if (rises.length === 0 && materials.length === 0) return undefined;
  const posts = rises.length > 0 ? decodeTile(rises, -MOST_RISE, MOST_RISE) : new Int32Array(TILE_SIDE * TILE_SIDE);
  const own = materials.length > 0 ? decodeTile(materials, 0, MATERIALS) : undefined;
  let lowest = 0, highest = 0;
  for (let k = 0; k < posts.length; ++k) {
    lowest = Math.min(lowest, posts[k]!);
    highest = Math.max(highest, posts[k]!);
    posts[k] = posts[k]! * 16 + (own?.[k] ?? 0);
  }
  return { posts, lowest, highest };
}
