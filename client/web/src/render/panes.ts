// The two pictures, each as up to date and as fine as the graphics card allows: what a sample costs is measured, and while the camera
// moves as many are drawn as fit a frame, stretched; once it rests, the picture goes finer, a tile at a time. No call waits for the card.

import { DataTexture, FloatType, LinearFilter, NearestFilter, RGBAFormat, WebGLRenderTarget, WebGLRenderer } from 'three';
import type { Dots } from './dots';
import { FullScreen, Rectangle } from './full_screen';
import { terrainShaders } from './glsl';
import type { Leaves } from './leaves';
import { Uniform, View, ViewUniforms } from './view';

const COARSEST = 16; // pixels a sample, each way
const MOVING_BUDGET = 40; // ms a picture while the camera moves
const REFINING_BUDGET = 120; // ms for the mesh's while only the mesh changes
const STEP_BUDGET = 25; // ms of work that is given to the card at a time
const REST = 400; // ms without a change, then the mesh is drawn in full
const TILES = [64, 32, 16]; // samples a side: the largest that the card does in good time

export type Kind = 'mesh' | 'march';

class Layer {
  readonly surface: WebGLRenderTarget;
  readonly picture: WebGLRenderTarget;
  constructor(
    readonly width: number,
    readonly height: number,
    withDepth: boolean,
  ) {
    this.surface = new WebGLRenderTarget(width, height, { type: FloatType, format: RGBAFormat, minFilter: NearestFilter, magFilter: NearestFilter, depthBuffer: withDepth, generateMipmaps: false });
    this.picture = new WebGLRenderTarget(width, height, { minFilter: LinearFilter, magFilter: LinearFilter, depthBuffer: false, generateMipmaps: false });
  }
  dispose(): void {
    this.surface.dispose();
    this.picture.dispose();
  }
}

/** The programs of one world. */
export class Programs {
  readonly march: FullScreen;
  readonly shade: FullScreen;
  readonly heights: FullScreen;
  readonly own = {
    marchLowest: { value: -131072 },
    marchHighest: { value: 131072 },
    shadeSurface: { value: null as DataTexture | null },
    showNodes: { value: 0 },
    heightsSpacing: { value: 0 },
    heightsSide: { value: 1 },
  };
  constructor(source: string, view: ViewUniforms) {
    const texts = terrainShaders(source);
    const uniforms: Record<string, Uniform> = { ...view.all, ...this.own };
    this.march = new FullScreen(texts.march, uniforms);
    this.shade = new FullScreen(texts.shade, uniforms);
    this.heights = new FullScreen(texts.heights, uniforms);
  }
  dispose(): void {
    for (const program of [this.march, this.shade, this.heights]) program.dispose();
  }
}

/** What everything is drawn with. */
export interface Tools {
  renderer: WebGLRenderer;
  uniforms: ViewUniforms;
  programs: Programs;
  leaves: Leaves;
  dots: Dots;
}

export interface Overlays {
  wireframe: boolean;
  nodes: boolean;
  candidates: boolean;
}

const coarser = (view: View, n: number): View => ({ ...view, width: Math.max(1, Math.floor(view.width / n)), height: Math.max(1, Math.floor(view.height / n)) });
const same = (a: View, b: View): boolean =>
  a.width === b.width && a.height === b.height && a.verticalFov === b.verticalFov && a.horizon === b.horizon && (Object.keys(a.pose) as (keyof View['pose'])[]).every((k) => a.pose[k] === b.pose[k]);

export class Pane {
  shown: Layer | undefined;
  coarseness = COARSEST; // of what is shown
  milliseconds = 0; // that it took
  drawnTriangles = 0;
  private shownView: View | undefined; // of the whole picture
  private shownOf = ''; // overlays and, of the mesh, version
  private job: { layer: Layer; view: View; full: View; coarseness: number; side: number; tile: number; tiles: number; drawn: boolean; of: string; spent: number } | undefined;
  private spare: Layer | undefined;
  private perSample = 5e-3; // ms; pessimistic until it was measured
  private perMesh = 0; // ms for drawing the mesh's triangles, whatever the size
  private changedAt = 0;
  private movedAt = 0;
  private lastView: View | undefined;
  private lastOf = '';

  constructor(readonly kind: Kind) {}

  /** Whether what is shown is the picture of this view, in full. */
  isFinest(view: View, of: string): boolean {
    return this.shownView !== undefined && this.coarseness === 1 && this.shownOf === of && same(this.shownView, view);
  }
  get busy(): boolean {
    return this.job !== undefined;
  }
  ofNow(tools: Tools, overlays: Overlays): string {
    return this.kind === 'march' ? '' : `${tools.leaves.version} ${overlays.candidates ? tools.dots.version : -1} ${overlays.wireframe} ${overlays.nodes}`;
  }

  /** Does a portion of what is to be done. Returns what it is estimated to take, in ms; 0: nothing was to be done. */
  step(tools: Tools, view: View, overlays: Overlays, now: number): number {
    const of = this.ofNow(tools, overlays);
    if (!this.lastView || !same(this.lastView, view)) this.movedAt = now;
    if (of !== this.lastOf) this.changedAt = now;
    this.lastView = view;
    this.lastOf = of;
    const moving = now - this.movedAt < 150;
    if (this.job && !same(this.job.full, view) && this.estimate(this.job.view) > MOVING_BUDGET * 2) this.abandon();
    if (!this.job && !this.begin(view, of, moving, now)) return 0;
    return this.advance(tools, overlays);
  }

  /** The card has done what step() gave it, in so many ms. */
  measured(samples: number, milliseconds: number): void {
    if (this.job) this.job.spent += milliseconds;
    else this.milliseconds += milliseconds;
    if (samples > 0) this.perSample = 0.5 * this.perSample + (0.5 * milliseconds) / samples;
    else this.perMesh = 0.5 * this.perMesh + 0.5 * milliseconds;
  }
  samplesOfStep = 0;

  dispose(): void {
    for (const layer of [this.shown, this.spare, this.job?.layer]) layer?.dispose();
    this.shown = this.spare = this.job = undefined;
    this.shownView = undefined;
  }

  private estimate(view: View): number {
    return this.perMesh + view.width * view.height * this.perSample;
  }
  private fitting(view: View, budget: number): number {
    let n = 1;
    while (n < COARSEST && this.estimate(coarser(view, n)) > budget) n *= 2;
    return Math.max(n, this.coarseness / 4); // no leaps on the word of one measurement
  }
  private abandon(): void {
    this.spare?.dispose();
    this.spare = this.job?.layer;
    this.job = undefined;
  }

  private begin(view: View, of: string, moving: boolean, now: number): boolean {
    const current = this.shownView !== undefined && same(this.shownView, view) && this.shownOf === of;
    let n: number;
    if (moving) {
      if (current) return false;
      n = this.shown ? this.fitting(view, MOVING_BUDGET) : COARSEST;
    } else if (!current) {
      n = this.kind === 'mesh' && now - this.changedAt < REST ? this.fitting(view, REFINING_BUDGET) : this.fitting(view, 4 * REFINING_BUDGET);
    } else {
      if (this.coarseness === 1 || (this.kind === 'mesh' && now - this.changedAt < REST)) return false;
      n = this.kind === 'mesh' ? 1 : Math.max(1, this.coarseness / 4);
    }
    const samples = coarser(view, n);
    if (!this.spare || this.spare.width !== samples.width || this.spare.height !== samples.height) {
      this.spare?.dispose();
      this.spare = new Layer(samples.width, samples.height, this.kind === 'mesh');
    }
    const side = TILES.find((t) => t * t * this.perSample < 2 * STEP_BUDGET) ?? TILES[TILES.length - 1]!;
    const tiles = Math.ceil(samples.width / side) * Math.ceil(samples.height / side);
    this.job = { layer: this.spare, view: samples, full: view, coarseness: n, side, tile: 0, tiles, drawn: this.kind === 'march', of, spent: 0 };
    this.spare = undefined;
    return true;
  }

  private advance(tools: Tools, overlays: Overlays): number {
    const job = this.job!;
    const { renderer, uniforms, programs, leaves } = tools;
    uniforms.set(job.view);
    if (!job.drawn) {
      this.drawnTriangles = leaves.draw(renderer, job.view, job.layer.surface, overlays.wireframe);
      job.drawn = true;
      this.samplesOfStep = 0;
      return Math.max(1, this.perMesh);
    }
    programs.own.shadeSurface.value = job.layer.surface.texture as DataTexture;
    programs.own.showNodes.value = this.kind === 'mesh' && overlays.nodes ? 1 : 0;
    // As many tiles as the budget has room for, whole rows where possible.
    const columns = Math.ceil(job.view.width / job.side);
    const perTile = job.side * job.side * this.perSample;
    let count = Math.max(1, Math.min(job.tiles - job.tile, Math.floor(STEP_BUDGET / perTile)));
    const column = job.tile % columns;
    if (column === 0 && count >= columns) count -= count % columns;
    else count = Math.min(count, columns - column);
    const rows = Math.max(1, Math.floor(count / columns));
    const x = column * job.side, y = Math.floor(job.tile / columns) * job.side;
    const only: Rectangle = {
      x,
      y,
      width: Math.min(count >= columns ? job.view.width : count * job.side, job.view.width - x),
      height: Math.min(rows * job.side, job.view.height - y),
    };
    if (this.kind === 'march') programs.march.run(renderer, job.layer.surface, only);
    programs.shade.run(renderer, job.layer.picture, only);
    job.tile += count;
    this.samplesOfStep = only.width * only.height;
    if (job.tile >= job.tiles) {
      if (this.kind === 'mesh' && overlays.candidates) tools.dots.draw(renderer, job.view, job.layer.surface, job.layer.picture);
      this.complete();
    }
    return Math.max(0.1, this.samplesOfStep * this.perSample);
  }

  private complete(): void {
    const job = this.job!;
    this.spare?.dispose();
    this.spare = this.shown;
    this.shown = job.layer;
    this.shownView = job.full;
    this.shownOf = job.of;
    this.coarseness = job.coarseness;
    this.milliseconds = job.spent;
    this.job = undefined;
  }
}
