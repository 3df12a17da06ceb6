// The painter: draws the mesh that the engine hands over, and the ray march of the same view, on a canvas of the page. It gives the
// graphics card a portion of work at a time and looks whether it is done, so that neither the page nor the engine ever waits for it.

import { DataTexture, FloatType, LinearSRGBColorSpace, NearestFilter, NoToneMapping, RGBAFormat, WebGLRenderTarget, WebGLRenderer } from 'three';
import type { FromPainter, FromPainterToEngine, Look, ToPainter, ToPainterFromEngine } from './messages';
import { Dots } from './render/dots';
import { FullScreen } from './render/full_screen';
import { PRESENT } from './render/glsl';
import { Leaves } from './render/leaves';
import { Pane, Programs, Tools } from './render/panes';
import { Pose, View, ViewUniforms } from './render/view';

const BOUNDS_SIDE = 512; // samples over the ground around the camera, to know how high it gets
const BOUNDS_MARGIN = 4000; // metres that the camera may fly before it is looked again
const HEIGHT_MARGIN = 400; // metres for what lies between the samples

const page = self as unknown as { postMessage(message: FromPainter): void; onmessage: ((event: MessageEvent<ToPainter>) => void) | null };

let renderer: WebGLRenderer | undefined;
let gl: WebGL2RenderingContext;
let canvas: OffscreenCanvas;
let engine: MessagePort;
let tools: Tools | undefined;
let world: { source: string; seed: number; horizon: number } | undefined;
let look: Look = { mode: 'mesh', divider: 0.5, wireframe: false, nodes: false, candidates: false };
let pose: Pose | undefined;
let verticalFov = 1;
let size = { width: 1, height: 1 };
let resized = false;
let pictureWanted = false;
let groundWanted: Pose | undefined;
let shownLook = '';
const uniforms = new ViewUniforms();
const panes = { mesh: new Pane('mesh'), march: new Pane('march') };
const presenting = { picture: { value: null as DataTexture | null }, windowSize: { value: [1, 1] } };
let presenter: FullScreen;
let leaves: Leaves;
let dots: Dots;

// What was given to the card and is not known to be done.
let given: { sync: WebGLSync; at: number; parts: { pane: Pane; samples: number; estimate: number }[] } | undefined;
let quickest = Infinity; // ms: what looking itself takes
let scheduled = false;
let marchIsNext = false; // in 'split'
let frames = 0, framesSince = performance.now();
const heard = { messages: 0, changes: 0 };

function problem(sentence: string, fatal: boolean): void {
  page.postMessage({ kind: 'problem', sentence, fatal });
}

function begin(message: Extract<ToPainter, { kind: 'begin' }>): void {
  canvas = message.canvas;
  engine = message.engine;
  engine.onmessage = (event: MessageEvent<ToPainterFromEngine>) => hear(event.data);
  const context = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false, powerPreference: 'high-performance' });
  if (!context) return problem('This browser offers no WebGL 2 here. Turn on hardware acceleration in its settings, update its graphics driver, or try another browser.', true);
  if (!context.getExtension('EXT_color_buffer_float')) return problem('This graphics card cannot draw into floating-point textures (EXT_color_buffer_float), which the viewer needs. Try another browser or machine.', true);
  gl = context;
  renderer = new WebGLRenderer({ canvas: canvas as unknown as HTMLCanvasElement, context, antialias: false, depth: false });
  renderer.autoClear = false;
  renderer.sortObjects = false;
  renderer.toneMapping = NoToneMapping;
  renderer.outputColorSpace = LinearSRGBColorSpace; // the shaders make display values themselves
  renderer.setClearColor(0, 0);
  canvas.addEventListener('webglcontextlost', () => problem('The graphics card was taken away from this page (its driver started anew, or memory ran out). Reload the page.', true));
  presenter = new FullScreen(PRESENT, presenting);
  leaves = new Leaves(uniforms);
  dots = new Dots(uniforms);
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  page.postMessage({ kind: 'ready', renderer: String(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : gl.getParameter(gl.RENDERER)) });
}

async function enter(next: NonNullable<typeof world>): Promise<void> {
  if (!renderer || (world && world.source === next.source && world.seed === next.seed && world.horizon === next.horizon)) return;
  world = next;
  const drawing = renderer;
  let programs: Programs | undefined;
  for (const source of next.source ? [next.source, ''] : ['']) {
    const complaints: string[] = [];
    drawing.debug.onShaderError = (context, program, vertex, fragment) => {
      complaints.push(context.getShaderInfoLog(fragment) || context.getShaderInfoLog(vertex) || context.getProgramInfoLog(program) || 'no reason given');
    };
    const made = new Programs(source, uniforms);
    try {
      // Errors show when a program is used.
      const tiny = new WebGLRenderTarget(1, 1, { type: FloatType, format: RGBAFormat, depthBuffer: false });
      for (const program of [made.shade, made.heights, made.march]) program.run(drawing, tiny);
      await drawing.readRenderTargetPixelsAsync(tiny, 0, 0, 1, 1, new Float32Array(4)); // a driver may compile only now
      tiny.dispose();
    } catch (error) {
      complaints.push(String(error));
    }
    if (world !== next) return made.dispose(); // another one came meanwhile
    if (complaints.length === 0) {
      programs = made;
      break;
    }
    made.dispose();
    problem(
      source ? `This graphics driver does not compile the terrain's text (${complaints[0]!.trim().slice(0, 300)}); it is drawn in neutral colours, without a ray march.` : `This graphics driver does not compile the viewer's shaders: ${complaints[0]!.trim().slice(0, 300)}`,
      !source,
    );
  }
  if (!programs) return;
  tools?.programs.dispose();
  panes.mesh.dispose();
  panes.march.dispose();
  bounds = undefined;
  tools = { renderer: drawing, uniforms, programs, leaves, dots };
  uniforms.all.viewSeed.value = next.seed;
  schedule();
}

function hear(message: ToPainterFromEngine): void {
  if (message.kind === 'world') {
    void enter(message);
  } else if (message.kind === 'candidates') {
    if (renderer) dots.set(message.candidates);
    schedule();
  } else {
    ++heard.changes;
    if (renderer) leaves.apply(message.gone, message.fresh, message.clear);
    engine.postMessage({ kind: 'taken' } satisfies FromPainterToEngine);
    schedule();
  }
}

// ---- heights ----

let bounds: { x: number; z: number } | undefined;
let heightsBusy = false;

async function heightsAround(at: Pose, side: number, spacing: number): Promise<Float32Array> {
  const { programs } = tools!;
  const target = new WebGLRenderTarget(side, side, { type: FloatType, format: RGBAFormat, minFilter: NearestFilter, magFilter: NearestFilter, depthBuffer: false });
  try {
    uniforms.set({ pose: at, width: side, height: side, verticalFov: 1, horizon: world!.horizon });
    programs.own.heightsSide.value = side;
    programs.own.heightsSpacing.value = spacing;
    programs.heights.run(renderer!, target);
    const out = new Float32Array(4 * side * side);
    await renderer!.readRenderTargetPixelsAsync(target, 0, 0, side, side, out);
    return out;
  } finally {
    target.dispose();
  }
}

function boundsAreDue(at: Pose): boolean {
  return look.mode !== 'mesh' && world!.source !== '' && (!bounds || Math.hypot(at.x - bounds.x, at.z - bounds.z) > BOUNDS_MARGIN * 256);
}

async function lookAtHeights(): Promise<void> {
  if (!tools || heightsBusy || !world?.source) return;
  heightsBusy = true;
  const mine = tools;
  try {
    if (groundWanted) {
      const at = groundWanted;
      groundWanted = undefined;
      const [metres] = await heightsAround(at, 1, 0);
      page.postMessage({ kind: 'ground', metres: metres! });
    }
    if (pose && boundsAreDue(pose)) {
      const at = pose;
      const heights = await heightsAround(at, BOUNDS_SIDE, (2 * (world.horizon + BOUNDS_MARGIN)) / BOUNDS_SIDE);
      let low = Infinity, high = -Infinity;
      for (let k = 0; k < heights.length; k += 4) (low = Math.min(low, heights[k]!)), (high = Math.max(high, heights[k]!));
      if (mine === tools) {
        bounds = { x: at.x, z: at.z };
        mine.programs.own.marchLowest.value = low - HEIGHT_MARGIN;
        mine.programs.own.marchHighest.value = high + HEIGHT_MARGIN;
      }
    }
  } finally {
    heightsBusy = false;
    schedule();
  }
}

// ---- frames ----

function schedule(): void {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(frame);
}

function isDone(): boolean {
  if (!given) return true;
  const status = gl.clientWaitSync(given.sync, 0, 0);
  if (status === gl.TIMEOUT_EXPIRED) return false;
  gl.deleteSync(given.sync);
  const took = performance.now() - given.at;
  quickest = Math.min(quickest, took);
  const total = given.parts.reduce((sum, part) => sum + part.estimate, 0);
  for (const { pane, samples, estimate } of given.parts) pane.measured(samples, ((took - 0.8 * quickest) * estimate) / total);
  given = undefined;
  return true;
}

function frame(): void {
  scheduled = false;
  if (!tools || !world) return;
  if (!isDone()) {
    // Not in a frame of its own: it may be done long before the next.
    scheduled = true;
    setTimeout(() => ((scheduled = false), frame()), 3);
    return;
  }
  if (groundWanted && world.source) void lookAtHeights();
  if (!pose) return;
  if (boundsAreDue(pose)) void lookAtHeights();
  if (resized) {
    resized = false;
    canvas.width = size.width;
    canvas.height = size.height;
    renderer!.setViewport(0, 0, size.width, size.height);
    shownLook = '';
  }
  const view: View = { pose, ...size, verticalFov, horizon: world.horizon };
  const now = performance.now();
  const parts: NonNullable<typeof given>['parts'] = [];
  const before = panes.mesh.shown, beforeMarch = panes.march.shown;
  let left = 25, more = false;
  // The mesh's picture is finished once it is begun; the ray march, which may take long, gets a portion in between.
  marchIsNext = !marchIsNext && !panes.mesh.busy;
  for (const pane of marchIsNext ? [panes.march, panes.mesh] : [panes.mesh, panes.march]) {
    if (left < 17) {
      more = true; // one at a time, so that what it took is known to be its own
      break;
    }
    if (look.mode !== 'split' && look.mode !== pane.kind) continue;
    if (pane.kind === 'march' && (!world.source || !bounds)) continue;
    do {
      const estimate = pane.step(tools, view, look, now);
      if (estimate === 0) break;
      more = true;
      parts.push({ pane, samples: pane.samplesOfStep, estimate });
      left -= estimate;
    } while (left > 0 && pane.busy);
    more ||= !pane.isFinest(view, pane.ofNow(tools, look));
  }
  const of = JSON.stringify(look);
  if (panes.mesh.shown !== before || panes.march.shown !== beforeMarch || of !== shownLook || pictureWanted) present(of);
  if (parts.length > 0) {
    given = { sync: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0)!, at: now, parts };
    gl.flush();
  }
  tell(view, more);
  if (more || pictureWanted || resized || groundWanted) schedule();
}

function finest(view: View): boolean {
  return [panes.mesh, panes.march].every((pane) => (look.mode !== 'split' && look.mode !== pane.kind) || (pane.kind === 'march' && !world?.source) || pane.isFinest(view, pane.ofNow(tools!, look)));
}

function tell(view: View, more: boolean): void {
  const since = performance.now() - framesSince;
  if (since < 500 && more) return;
  const main = look.mode === 'march' ? panes.march : panes.mesh;
  page.postMessage({
    kind: 'frames',
    perSecond: since > 0 ? (frames * 1000) / since : 0,
    coarseness: main.coarseness,
    milliseconds: main.milliseconds,
    finest: finest(view),
    drawnTriangles: panes.mesh.drawnTriangles,
    ...heard,
  });
  frames = 0;
  framesSince = performance.now();
}

function present(of: string): void {
  const divider = look.mode === 'split' ? Math.round(look.divider * size.width) : look.mode === 'mesh' || !world?.source ? size.width : 0;
  presenting.windowSize.value = [size.width, size.height];
  renderer!.setRenderTarget(null);
  renderer!.setScissorTest(true);
  for (const [pane, x, width] of [
    [panes.mesh, 0, divider],
    [panes.march, divider, size.width - divider],
  ] as const) {
    if (width <= 0 || !pane.shown) continue;
    renderer!.setScissor(x, 0, width, size.height);
    presenting.picture.value = pane.shown.picture.texture as DataTexture;
    presenter.run(renderer!, null);
  }
  renderer!.setScissorTest(false);
  shownLook = of;
  ++frames;
  if (pictureWanted) {
    pictureWanted = false;
    void canvas.convertToBlob({ type: 'image/png' }).then((png) => page.postMessage({ kind: 'picture', png }));
  }
}

page.onmessage = ({ data }) => {
  ++heard.messages;
  switch (data.kind) {
    case 'begin':
      begin(data);
      break;
    case 'size':
      size = { width: data.width, height: data.height };
      resized = true;
      break;
    case 'pose':
      pose = data.pose;
      verticalFov = data.verticalFov;
      break;
    case 'look':
      look = data.look;
      break;
    case 'ground':
      groundWanted = data.pose;
      break;
    case 'picture':
      pictureWanted = true;
      break;
  }
  if (renderer) schedule();
};
