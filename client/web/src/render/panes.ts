// The two pictures, each as up to date and as fine as the graphics card allows: what a sample costs is measured, and while the camera
// moves as many are drawn as fit a frame, stretched; once it rests, the picture goes finer, a tile at a time. No call waits for the card.
// The mesh is corrected onto the true surface (common/shaders/correct.glsl) where the picture still stays within its time, and last of all
// where nothing changes any more.

import { FloatType, LinearFilter, NearestFilter, RGBAFormat, WebGLRenderTarget, WebGLRenderer } from 'three';
import type { Look } from '../messages';
import type { Edits } from './edits';
import type { Rectangle } from './full_screen';
import type { Leaves } from './leaves';
import type { Programs } from './programs';
import { Skyline } from './skyline';
import { View, ViewUniforms, samePose } from './view';

const COARSEST = 16, AT_REST = 4; // pixels a sample, each way: at most, and at most while the camera rests
const MOVING_BUDGET = 40; // ms a picture while the camera moves
const REFINING_BUDGET = 120; // ms for the mesh's while only the mesh changes
const STEP_BUDGET = 25, COARSE_BUDGET = 100; // ms of work that is given to the card at a time; of coarse pictures, which slow cards alone draw
const MOVING = 100; // ms after the view changed
const KEEPS_UP = 0.7; // of the time of a picture: what was too late for the correction comes back within this
const REST = 400; // ms without a change, then the mesh is drawn in full
const TILES = [64, 32, 16]; // samples a side: the largest that the card does in good time

const surfaceOf = (width: number, height: number, withDepth: boolean): WebGLRenderTarget =>
  new WebGLRenderTarget(width, height, { type: FloatType, format: RGBAFormat, minFilter: NearestFilter, magFilter: NearestFilter, depthBuffer: withDepth, generateMipmaps: false });

class Layer {
  readonly surface: WebGLRenderTarget;
  readonly picture: WebGLRenderTarget;
  constructor(
    readonly width: number,
    readonly height: number,
    withDepth: boolean,
  ) {
    this.surface = surfaceOf(width, height, withDepth);
    this.picture = new WebGLRenderTarget(width, height, { minFilter: LinearFilter, magFilter: LinearFilter, depthBuffer: false, generateMipmaps: false });
  }
  dispose(): void {
    this.surface.dispose();
    this.picture.dispose();
  }
}

/** What everything is drawn with. */
export interface Tools {
  renderer: WebGLRenderer;
  uniforms: ViewUniforms;
  programs: Programs;
  leaves: Leaves;
  edits: Pick<Edits, 'version'>;
  canCorrect: boolean; // the mesh is to be corrected, and can be
}

const coarser = (view: View, n: number): View => ({ ...view, width: Math.max(1, Math.floor(view.width / n)), height: Math.max(1, Math.floor(view.height / n)) });
const same = (a: View, b: View): boolean =>
  a.width === b.width && a.height === b.height && a.verticalFov === b.verticalFov && a.horizon === b.horizon && samePose(a.pose, b.pose);

/** Work of one kind: the milliseconds that the card takes for each unit, as far as that was measured. What any portion costs, however
 *  small, would make units of less than `trusted` seem dear: these only make them cheaper. */
class Rate {
  constructor(
    public each: number,
    private readonly trusted = 0,
  ) {}
  measured(amount: number, milliseconds: number): void {
    const each = milliseconds / amount;
    if (amount >= this.trusted || each < this.each) this.each = 0.5 * this.each + 0.5 * each;
  }
}

/** What a step gave the card to do. */
export interface Portion {
  rate: Rate;
  amount: number;
  estimate: number; // ms
}

interface Wanted {
  coarseness: number;
  corrected: boolean;
}

interface Job extends Wanted {
  layer: Layer;
  view: View; // of the samples
  full: View; // of the whole picture
  side: number; // of a tile
  tile: number;
  tiles: number;
  of: string;
  spent: number; // ms
}

export abstract class Pane {
  shown: Layer | undefined;
  pictures = 0; // that were shown
  coarseness = COARSEST; // of what is shown
  corrected = false; // what is shown
  milliseconds = 0; // that it took
  shownView: View | undefined; // of the whole picture
  private shownOf = ''; // overlays and, of the mesh, version
  private job: Job | undefined;
  private spare: Layer | undefined;
  protected changedAt = 0;
  private movedAt = 0;
  private lastView: View | undefined;
  private lastOf = '';

  protected constructor(
    private readonly withDepth: boolean,
    protected readonly perSample: Rate,
  ) {}

  /** What the picture depends on beside the view. */
  abstract ofNow(tools: Tools, look: Look): string;
  /** Work that comes before the samples of a picture: ms, about; its beginning; and a portion of it, nothing when it is done. */
  protected abstract costBefore(view: View): number;
  /** What any picture costs, however coarse: ms. */
  protected fixedCost(): number {
    return 0;
  }
  /** What the correction costs beside all else: ms; nothing where there is none. */
  protected correctionCost(_view: View, _tools: Tools): number | undefined {
    return undefined;
  }
  protected abstract beginBefore(view: View, tools: Tools): void;
  protected abstract before(job: Job, tools: Tools, look: Look): Portion | undefined;
  /** How many pixels a sample may stand for, each way, where the camera rests and this view is already shown; 0: nothing is to be drawn. */
  protected abstract nextCoarseness(now: number): number;
  /** ms a picture while the camera rests. */
  protected abstract restingBudget(now: number): number;
  protected abstract draw(job: Job, tools: Tools, look: Look, only: Rectangle): void;

  /** Whether what is shown is the picture of this view, in full. */
  isFinest(view: View, tools: Tools, look: Look): boolean {
    return this.isCurrent(view, this.ofNow(tools, look)) && this.coarseness === 1 && this.corrected === this.canCorrect(view, tools);
  }
  get busy(): boolean {
    return this.job !== undefined;
  }

  /** Does a portion of what is to be done; nothing: there was nothing to do. */
  step(tools: Tools, view: View, look: Look, now: number): Portion | undefined {
    const of = this.ofNow(tools, look);
    if (!this.lastView || !same(this.lastView, view)) this.movedAt = now;
    if (of !== this.lastOf) this.changedAt = now;
    this.lastView = view;
    this.lastOf = of;
    const moving = !view.rests && now - this.movedAt < MOVING;
    if (this.job && !this.isWorthwhile(this.job, view)) this.abandon();
    if (!this.job) {
      const wanted = this.wanted(view, of, moving, now, tools);
      if (!wanted) return undefined;
      this.begin(view, of, wanted, tools);
    }
    tools.uniforms.set(this.job!.view);
    return this.before(this.job!, tools, look) ?? this.samples(this.job!, tools, look);
  }

  /** The card has done what step() gave it, in so many ms. */
  measured({ rate, amount }: Portion, milliseconds: number): void {
    if (this.job) this.job.spent += milliseconds;
    else this.milliseconds += milliseconds;
    rate.measured(amount, milliseconds);
  }

  dispose(): void {
    for (const layer of [this.shown, this.spare, this.job?.layer]) layer?.dispose();
    this.shown = this.spare = this.job = undefined;
    this.shownView = undefined;
  }

  private estimate(view: View): number {
    return this.costBefore(view) + view.width * view.height * this.perSample.each;
  }
  /** Where a picture costs much however coarse it is, its samples may cost as much again. */
  protected fitting(view: View, budget: number): number {
    const most = Math.max(budget, 2 * this.fixedCost());
    let n = 1;
    while (n < COARSEST && this.estimate(coarser(view, n)) > most) n *= 2;
    return Math.max(n, this.coarseness / 4); // no leaps on the word of one measurement
  }
  /** Whether what is being drawn is to be finished now that this is the view. Before a stop is known, a coarse picture of it may have begun. */
  private isWorthwhile(job: Job, view: View): boolean {
    if (view.rests) return same(job.full, view) && job.coarseness <= AT_REST;
    return same(job.full, view) || this.estimate(job.view) <= 2 * this.estimate(coarser(view, this.fitting(view, MOVING_BUDGET)));
  }
  private abandon(): void {
    this.spare?.dispose();
    this.spare = this.job?.layer;
    this.job = undefined;
  }

  private isCurrent(view: View, of: string): boolean {
    return this.shownView !== undefined && same(this.shownView, view) && this.shownOf === of;
  }
  private canCorrect(view: View, tools: Tools): boolean {
    return this.correctionCost(view, tools) !== undefined;
  }
  private correctsInTime(view: View, budget: number, tools: Tools): boolean {
    const more = this.correctionCost(view, tools);
    return more !== undefined && this.estimate(view) + more <= (this.corrected ? 1 : KEEPS_UP) * budget;
  }

  /** The picture that is to be drawn now, if any. */
  private wanted(view: View, of: string, moving: boolean, now: number, tools: Tools): Wanted | undefined {
    const current = this.isCurrent(view, of), canCorrect = this.canCorrect(view, tools);
    if (current && (moving || (this.coarseness === 1 && this.corrected === canCorrect))) return undefined;
    const budget = moving ? (this.shown ? MOVING_BUDGET : REFINING_BUDGET) : this.restingBudget(now);
    const coarseness = current ? this.nextCoarseness(now) : Math.min(moving ? COARSEST : AT_REST, this.fitting(view, budget));
    if (coarseness === 0) return undefined;
    const last = current && this.coarseness === 1; // nothing is left but the correction, or to take it back
    const soon = current ? budget : Math.min(budget, REFINING_BUDGET); // who stops wants a picture first
    return { coarseness, corrected: last ? canCorrect : this.correctsInTime(coarser(view, coarseness), soon, tools) };
  }

  private begin(full: View, of: string, wanted: Wanted, tools: Tools): void {
    const view = coarser(full, wanted.coarseness);
    if (!this.spare || this.spare.width !== view.width || this.spare.height !== view.height) {
      this.spare?.dispose();
      this.spare = new Layer(view.width, view.height, this.withDepth);
    }
    const side = TILES.find((t) => t * t * this.perSample.each < 2 * STEP_BUDGET) ?? TILES[TILES.length - 1]!;
    const tiles = Math.ceil(view.width / side) * Math.ceil(view.height / side);
    this.job = { ...wanted, layer: this.spare, view, full, side, tile: 0, tiles, of, spent: 0 };
    this.spare = undefined;
    this.beginBefore(view, tools);
  }

  /** As many tiles as the budget has room for, whole rows where possible. */
  private samples(job: Job, tools: Tools, look: Look): Portion {
    const { view, side } = job;
    const columns = Math.ceil(view.width / side), column = job.tile % columns;
    const budget = job.coarseness === 1 ? STEP_BUDGET : COARSE_BUDGET;
    let count = Math.max(1, Math.min(job.tiles - job.tile, Math.floor(budget / (side * side * this.perSample.each))));
    if (column === 0 && count >= columns) count -= count % columns;
    else count = Math.min(count, columns - column);
    const x = column * side, y = Math.floor(job.tile / columns) * side;
    const only: Rectangle = {
      x,
      y,
      width: Math.min(count >= columns ? view.width : count * side, view.width - x),
      height: Math.min(Math.max(1, Math.floor(count / columns)) * side, view.height - y),
    };
    this.draw(job, tools, look, only);
    job.tile += count;
    if (job.tile >= job.tiles) this.complete(job);
    const amount = only.width * only.height;
    return { rate: this.perSample, amount, estimate: Math.max(0.1, amount * this.perSample.each) };
  }

  private complete(job: Job): void {
    this.spare?.dispose();
    this.spare = this.shown;
    this.shown = job.layer;
    ++this.pictures;
    this.shownView = job.full;
    this.shownOf = job.of;
    this.coarseness = job.coarseness;
    this.corrected = job.corrected;
    this.milliseconds = job.spent;
    this.job = undefined;
  }

  protected shade({ layer }: Job, { renderer, programs }: Tools, nodes: boolean, only: Rectangle): void {
    programs.own.shadeSurface.value = layer.surface.texture;
    programs.own.showNodes.value = nodes ? 1 : 0;
    programs.shade.run(renderer, layer.picture, only);
  }
}

/** The streamed mesh: its triangles in one go, the correction some rows at a time, then its colours. */
export class MeshPane extends Pane {
  private readonly perMesh = new Rate(0); // whatever the size
  private readonly perCorrection = new Rate(5e-3, 4096); // of a sample
  private uncorrected: WebGLRenderTarget | undefined; // the mesh that is being corrected
  private drawn = false;
  private rows = 0; // that are corrected
  constructor() {
    super(true, new Rate(5e-3, 4096)); // pessimistic until it was measured
  }
  override ofNow({ leaves, edits, programs }: Tools, { wireframe, nodes }: Look): string {
    return `${leaves.version} ${edits.version} ${programs.isNeutral} ${wireframe} ${nodes}`;
  }
  protected override costBefore(): number {
    return this.perMesh.each;
  }
  protected override fixedCost(): number {
    return this.perMesh.each;
  }
  protected override correctionCost({ width, height }: View, { canCorrect }: Tools): number | undefined {
    return canCorrect ? width * height * this.perCorrection.each : undefined;
  }
  protected override beginBefore(): void {
    this.drawn = false;
    this.rows = 0;
  }
  protected override before(job: Job, tools: Tools, look: Look): Portion | undefined {
    const { view, layer } = job;
    if (this.drawn) return job.corrected && this.rows < view.height ? this.correct(job, tools) : undefined;
    this.drawn = true;
    tools.leaves.draw(tools.renderer, view, job.corrected ? this.roomFor(view) : layer.surface, look.wireframe);
    return { rate: this.perMesh, amount: 1, estimate: Math.max(1, this.perMesh.each) };
  }
  private roomFor({ width, height }: View): WebGLRenderTarget {
    this.uncorrected ??= surfaceOf(width, height, true);
    this.uncorrected.setSize(width, height);
    return this.uncorrected;
  }
  private correct({ view, layer, coarseness }: Job, { renderer, programs }: Tools): Portion {
    const perRow = view.width * this.perCorrection.each;
    const height = Math.min(view.height - this.rows, Math.max(1, Math.floor((coarseness === 1 ? STEP_BUDGET : COARSE_BUDGET) / perRow)));
    programs.own.correctSurface.value = this.uncorrected!.texture;
    programs.correct.run(renderer, layer.surface, { x: 0, y: this.rows, width: view.width, height });
    this.rows += height;
    return { rate: this.perCorrection, amount: view.width * height, estimate: Math.max(0.1, height * perRow) };
  }
  override dispose(): void {
    super.dispose();
    this.uncorrected?.dispose();
    this.uncorrected = undefined;
  }
  private changes(now: number): boolean {
    return now - this.changedAt < REST;
  }
  protected override restingBudget(now: number): number {
    return this.changes(now) ? REFINING_BUDGET : 4 * REFINING_BUDGET;
  }
  protected override nextCoarseness(now: number): number {
    if (this.coarseness > AT_REST) return AT_REST;
    return this.changes(now) ? 0 : 1;
  }
  protected override draw(job: Job, tools: Tools, look: Look, only: Rectangle): void {
    this.shade(job, tools, look.nodes, only);
  }
}

/** The ray march: its skyline some columns at a time, then tiles. */
export class MarchPane extends Pane {
  private readonly skyline = new Skyline();
  private readonly perSkyline = new Rate(5e-4); // for a column, and a line of the picture
  constructor() {
    super(false, new Rate(3e-2));
  }
  override ofNow({ edits }: Tools): string {
    return `${edits.version}`;
  }
  protected override costBefore(view: View): number {
    return Skyline.columnsOf(view) * view.height * this.perSkyline.each;
  }
  protected override beginBefore(view: View, { renderer }: Tools): void {
    this.skyline.begin(view, renderer);
  }
  protected override before({ view }: Job, { renderer, programs }: Tools): Portion | undefined {
    this.skyline.setUniforms(view, programs, renderer);
    const perColumn = view.height * this.perSkyline.each, columns = Math.min(this.skyline.left, Math.max(16, Math.floor(STEP_BUDGET / perColumn)));
    if (columns === 0) return undefined;
    this.skyline.draw(programs, renderer, columns);
    return { rate: this.perSkyline, amount: columns * view.height, estimate: Math.max(0.1, columns * perColumn) };
  }
  protected override restingBudget(): number {
    return 4 * REFINING_BUDGET;
  }
  protected override nextCoarseness(): number {
    return this.coarseness > AT_REST ? AT_REST : Math.max(1, this.coarseness / 4); // 8 to 2 would keep large blocks four times as long
  }
  protected override draw(job: Job, tools: Tools, _look: Look, only: Rectangle): void {
    tools.programs.march.run(tools.renderer, job.layer.surface, only);
    this.shade(job, tools, false, only);
  }
}
