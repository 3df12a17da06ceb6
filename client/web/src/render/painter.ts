// Draws the mesh that the engine hands over, and the ray march of the same view, on a canvas of the page. It gives the graphics card a
// portion of work at a time and looks whether it is done, so that neither the page nor the engine ever waits for it.

import { LinearSRGBColorSpace, NoToneMapping, WebGLRenderer } from 'three';
import type { FromPainter, FromPainterToEngine, Look, ToPainter, ToPainterFromEngine } from '../messages';
import { Card, Part } from './card';
import { Dots } from './dots';
import { Edits } from './edits';
import { Heights } from './heights';
import { Leaves } from './leaves';
import { MarchPane, MeshPane, Pane, Tools } from './panes';
import { Presenter, Size } from './presenter';
import { Programs } from './programs';
import { View, ViewUniforms } from './view';
import { WorldPrograms } from './world_programs';

const STEP_BUDGET = 25, LEAST_BUDGET = 17; // ms of work that is given to the card in a frame, and that a pane is begun with

type Begin = Extract<ToPainter, { kind: 'begin' }>;
type World = Extract<ToPainterFromEngine, { kind: 'world' }>;
type Tell = (message: FromPainter) => void;

const TAKEN_AWAY = 'The graphics card was taken away from this page (its driver restarted, or memory ran out). Reload the page.';

/** Where the pictures can be drawn; otherwise a sentence for people. */
function contextOf(canvas: OffscreenCanvas): WebGL2RenderingContext | string {
  const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false, powerPreference: 'high-performance' });
  if (!gl) return 'This browser offers no WebGL 2 here. Turn on hardware acceleration in its settings, update its graphics driver, or try another browser.';
  if (!gl.getExtension('EXT_color_buffer_float')) return 'This graphics card cannot draw into floating-point textures (EXT_color_buffer_float), which the viewer needs. Try another browser or machine.';
  return gl;
}

function rendererOn(canvas: OffscreenCanvas, context: WebGL2RenderingContext): WebGLRenderer {
  const renderer = new WebGLRenderer({ canvas: canvas as unknown as HTMLCanvasElement, context, antialias: false, depth: false });
  renderer.autoClear = false;
  renderer.sortObjects = false;
  renderer.toneMapping = NoToneMapping;
  renderer.outputColorSpace = LinearSRGBColorSpace; // the shaders make display values themselves
  renderer.setClearColor(0, 0);
  return renderer;
}

export class Painter {
  private readonly uniforms = new ViewUniforms();
  private readonly leaves = new Leaves(this.uniforms);
  private readonly dots = new Dots(this.uniforms);
  private readonly mesh = new MeshPane();
  private readonly march = new MarchPane();
  private readonly card: Card;
  private readonly renderer: WebGLRenderer;
  private readonly edits: Edits;
  private readonly presenter: Presenter;
  private world: World | undefined; // the newest
  private readonly neutral: Programs;
  private drawing: { programs: WorldPrograms; heights: Heights } | undefined;
  private look: Look = { mode: 'mesh', divider: 0.5, wireframe: false, nodes: false, candidates: false, corrected: true };
  private eye: Pick<View, 'pose' | 'verticalFov' | 'rests'> | undefined;
  private readonly wanted = { size: { width: 1, height: 1 } as Size, resize: false, picture: false };
  private readonly turn = { scheduled: false, marchIsNext: false, shownOf: '' }; // in 'split' panes take turns; the look and the pictures that are shown
  private readonly told = { frames: 0, coarseness: 0, at: performance.now() };
  private readonly heard = { messages: 1, changes: 0 };

  /** Nothing where pictures cannot be drawn; the page is told. */
  static begin({ canvas, engine }: Begin, tell: Tell): Painter | undefined {
    const gl = contextOf(canvas);
    if (typeof gl !== 'string') return new Painter(canvas, gl, engine, tell);
    tell({ kind: 'problem', sentence: gl, fatal: true });
    return undefined;
  }

  private constructor(
    private readonly canvas: OffscreenCanvas,
    gl: WebGL2RenderingContext,
    private readonly engine: MessagePort,
    private readonly tell: Tell,
  ) {
    this.card = new Card(gl);
    this.renderer = rendererOn(canvas, gl);
    this.presenter = new Presenter(this.renderer);
    this.edits = new Edits(this.renderer, this.uniforms);
    this.neutral = new Programs('', this.uniforms);
    void this.neutral.compile(['shade'], this.renderer); // before the world arrives
    canvas.addEventListener('webglcontextlost', () => this.problem(TAKEN_AWAY, true));
    engine.onmessage = (event: MessageEvent<ToPainterFromEngine>) => this.hearEngine(event.data);
  }

  /** What the page says. */
  hear(message: Exclude<ToPainter, Begin>): void {
    ++this.heard.messages;
    switch (message.kind) {
      case 'size':
        this.wanted.size = { width: message.width, height: message.height };
        this.wanted.resize = true;
        break;
      case 'pose':
        this.eye = { pose: message.pose, verticalFov: message.verticalFov, rests: message.rests };
        break;
      case 'look':
        this.look = message.look;
        break;
      case 'picture':
        this.wanted.picture = true;
        break;
    }
    this.schedule();
  }

  private hearEngine(message: ToPainterFromEngine): void {
    if (message.kind === 'world') return void this.enter(message);
    if (message.kind === 'candidates') {
      this.dots.set(message.candidates);
    } else {
      ++this.heard.changes;
      if (message.kind === 'squares') this.takeSquares(message);
      else this.leaves.apply(message);
      this.engine.postMessage({ kind: 'taken' } satisfies FromPainterToEngine);
    }
    this.schedule();
  }

  private takeSquares({ fresh, gone }: Extract<ToPainterFromEngine, { kind: 'squares' }>): void {
    this.edits.apply(fresh, gone);
    this.drawing?.heights.setBounds();
  }

  private problem(sentence: string, fatal: boolean): void {
    const isLost = this.renderer.getContext().isContextLost(); // then it is why anything else fails
    this.tell({ kind: 'problem', sentence: isLost ? TAKEN_AWAY : sentence, fatal: fatal || isLost });
  }

  private async enter(next: World): Promise<void> {
    const { world, renderer, uniforms } = this;
    if (world && world.source === next.source && world.seed === next.seed && world.horizon === next.horizon) return;
    this.world = next;
    const complaint = await this.neutral.compile(['shade'], renderer);
    if (complaint) return this.problem(`This graphics driver does not compile the viewer's shaders: ${complaint}`, true);
    if (this.world !== next) return; // another one came meanwhile
    this.drawing?.programs.dispose();
    this.mesh.dispose();
    this.march.dispose();
    uniforms.all.viewSeed.value = next.seed;
    const programs = new WorldPrograms(next.source, uniforms, this.neutral, renderer, { changed: () => this.schedule(), complain: (sentence) => this.problem(sentence, false) });
    this.drawing = { programs, heights: new Heights(renderer, uniforms, programs, this.edits, next.horizon) };
    this.schedule();
  }

  // ---- frames ----

  private schedule(): void {
    if (this.turn.scheduled) return;
    this.turn.scheduled = true;
    requestAnimationFrame(() => this.frame());
  }

  private frame(): void {
    this.turn.scheduled = false;
    if (!this.drawing || !this.world) return;
    if (!this.card.isDone()) {
      // Not in a frame of its own: it may be done long before the next.
      this.turn.scheduled = true;
      setTimeout(() => this.frame(), 3);
      return;
    }
    this.lookAtBounds();
    this.compileMore();
    if (!this.eye || (!this.leaves.areThere && !this.mesh.shown && !this.shows(this.march))) return;
    this.resize();
    this.edits.moveTo(this.eye.pose);
    const view: View = { ...this.eye, ...this.wanted.size, horizon: this.world.horizon };
    const now = performance.now();
    const { parts, more } = this.drawPortions(view, now);
    this.present();
    this.card.give(parts, now);
    this.tellFrames(view, more);
    if (more || this.wanted.resize) this.schedule();
  }

  private lookAtBounds(): void {
    const { heights } = this.drawing!;
    if (this.eye && this.shows(this.march) && heights.boundsAreDue(this.eye.pose)) void heights.findBounds(this.eye.pose).finally(() => this.schedule());
  }

  /** What can wait until there is a picture; a driver may draw nothing while it compiles. */
  private compileMore(): void {
    const { programs } = this.drawing!;
    if (!this.mesh.shown) return;
    void programs.wantColours();
    if (this.look.mode !== 'mesh') void programs.wantMarch();
    if (this.wantsCorrection && this.mesh.coarseness === 1) void programs.wantCorrection(); // the last that a picture lacks
  }

  private resize(): void {
    if (!this.wanted.resize) return;
    this.wanted.resize = false;
    this.canvas.width = this.wanted.size.width;
    this.canvas.height = this.wanted.size.height;
    this.renderer.setViewport(0, 0, this.wanted.size.width, this.wanted.size.height);
    this.turn.shownOf = '';
  }

  private wants(pane: Pane): boolean {
    const marches = this.look.mode !== 'mesh' && this.drawing!.programs.mayMarch;
    return pane === this.march ? marches : !marches || this.look.mode !== 'march';
  }
  /** The mesh stands in for the ray march until that has a picture. */
  private shows(pane: Pane): boolean {
    return pane === this.march ? this.wants(pane) && this.drawing!.programs.canMarch : this.wants(pane) || !this.march.shown;
  }
  private get wantsCorrection(): boolean {
    return this.look.corrected && this.look.mode !== 'march' && this.drawing!.programs.mayCorrect;
  }
  private get tools(): Tools {
    const { renderer, uniforms, leaves, edits } = this, { programs } = this.drawing!;
    return { renderer, uniforms, leaves, edits, programs: programs.current, canCorrect: this.wantsCorrection && programs.canCorrect };
  }

  private drawPortions(view: View, now: number): { parts: Part[]; more: boolean } {
    const { tools } = this, { heights } = this.drawing!, parts: Part[] = [];
    let left = STEP_BUDGET, more = false;
    // The mesh's picture is finished once it is begun; the ray march, which may take long, gets a portion in between.
    this.turn.marchIsNext = !this.turn.marchIsNext && !this.mesh.busy;
    for (const pane of this.turn.marchIsNext ? [this.march, this.mesh] : [this.mesh, this.march]) {
      if (left < LEAST_BUDGET) return { parts, more: true }; // one at a time, so that what it took is known to be its own
      if (!this.shows(pane) || (pane === this.march && !heights.boundsAreKnown)) continue;
      do {
        const portion = pane.step(tools, view, this.look, now);
        if (!portion) break;
        more = true;
        parts.push({ pane, portion });
        left -= portion.estimate;
      } while (left > 0 && pane.busy);
      more ||= !pane.isFinest(view, tools, this.look);
    }
    return { parts, more };
  }

  private present(): void {
    const { look, mesh, march, dots } = this, { size } = this.wanted;
    const of = JSON.stringify([look, mesh.pictures, march.pictures, look.candidates && dots.version]);
    if (of === this.turn.shownOf && !this.wanted.picture) return;
    this.turn.shownOf = of;
    const divider = !this.shows(march) || !march.shown ? size.width : look.mode === 'split' ? Math.round(look.divider * size.width) : 0;
    this.presenter.present(mesh, march, divider, size, look.candidates ? dots : undefined);
    ++this.told.frames;
    if (!this.wanted.picture) return;
    this.wanted.picture = false;
    void this.canvas.convertToBlob({ type: 'image/png' }).then((png) => this.tell({ kind: 'picture', png }));
  }

  private tellFrames(view: View, more: boolean): void {
    const { told, tools, look } = this, { programs } = this.drawing!, since = performance.now() - told.at;
    const { coarseness, corrected, milliseconds } = this.look.mode === 'march' && this.march.shown ? this.march : this.mesh;
    if (!this.mesh.shown && !this.march.shown) return;
    if (since < 500 && more && coarseness === told.coarseness) return;
    this.tell({
      kind: 'frames',
      perSecond: since > 0 ? (told.frames * 1000) / since : 0,
      coarseness,
      corrected,
      milliseconds,
      finest: programs.coloursAreFinal && this.wantsCorrection === tools.canCorrect && [this.mesh, this.march].every((pane) => !this.wants(pane) || pane.isFinest(view, tools, look)),
      ...this.heard,
    });
    this.told.frames = 0;
    this.told.coarseness = coarseness;
    this.told.at = performance.now();
  }
}
