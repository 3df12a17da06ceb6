// The page: reads hands, moves the camera, shows what the engine and the painter say. Nothing here takes long: what does runs in the
// two workers.

import './style.css';
import EngineWorker from './engine.worker?worker';
import PainterWorker from './painter.worker?worker';
import type { Figures, FromEngine, FromPainter, Look, MemberTold, Mode, ToEngine, ToPainter, WorldTold } from './messages';
import type { View } from './render/view';
import { ERROR_RANGE, errorColour } from './render/error_colour';
import { Flying, samePose } from './ui/flying';
import { Hands } from './ui/hands';
import { Place, readPlace, writePlace } from './ui/link';
import { Members } from './ui/members';

const VERTICAL_FOV = Math.PI / 3;
const POSE_INTERVAL = 33; // ms: poses a second at most 30
const MAX_PIXELS = 2.5e6; // of the canvas; more are not worth their time

function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

const canvas = element<HTMLCanvasElement>('view');
const place: Place = readPlace(location.hash);
const flying = new Flying(place.pose);
const members = new Members(element('members'));
const look: Look = { mode: place.mode, divider: 0.5, wireframe: false, nodes: false, candidates: false };
let token = place.token || sessionStorage.getItem('token') || '';
let threshold = place.threshold;
let figuresShown = false;
let groundWanted = !Number.isFinite(place.pose.y); // until the height at the start is known
let ground: number | undefined;
let world: WorldTold | undefined;
let figures: Figures | undefined;
let frames: Extract<FromPainter, { kind: 'frames' }> | undefined;
let others: MemberTold[] = [];
let lost = '';

const engine = new EngineWorker();
const painter = new PainterWorker();
const toEngine = (message: ToEngine, transfer: Transferable[] = []): void => engine.postMessage(message, transfer);
let posed = 0, painted = 0; // poses given to the engine, messages to the painter
const toPainter = (message: ToPainter, transfer: Transferable[] = []): void => {
  ++painted;
  painter.postMessage(message, transfer);
};

// ---- telling people ----

function problem(title: string, sentence: string, offer: 'nothing' | 'token' | 'again' = 'nothing'): void {
  const box = element('problem');
  box.querySelector('h2')!.textContent = title;
  box.querySelector('p')!.textContent = sentence;
  element('token').hidden = offer !== 'token';
  element('again').hidden = offer !== 'again';
  box.hidden = false;
}

let noteTimer = 0;
function note(sentence: string, ms = 2500): void {
  const box = element('note');
  box.textContent = sentence;
  box.hidden = sentence === '';
  clearTimeout(noteTimer);
  if (ms > 0) noteTimer = window.setTimeout(() => (box.hidden = true), ms);
}

function light(state: 'on' | 'wait' | 'off', text: string): void {
  element('light').dataset['state'] = state;
  element('world').textContent = text;
}

const count = (v: number): string => (v >= 1e6 ? `${(v / 1e6).toFixed(2)} M` : v >= 1e4 ? `${(v / 1e3).toFixed(0)} k` : String(Math.round(v)));

// Which colour is which error.
function showLegend(): void {
  const box = element('legend');
  box.hidden = !look.candidates || look.mode === 'march' || !figures;
  if (box.hidden) return;
  const unit = Math.max(figures!.effectiveThreshold, 1e-3), text = `${figures!.candidates} ${unit}`;
  if (box.dataset['of'] === text) return;
  box.dataset['of'] = text;
  box.replaceChildren(`${figures!.candidates} candidates, error in pixels`);
  for (const share of [1 / ERROR_RANGE, 0.5, 1, 2, ERROR_RANGE]) {
    const entry = document.createElement('span'), colour = document.createElement('i');
    colour.style.background = `rgb(${errorColour(share, 1).map((c) => Math.round(255 * c)).join(' ')})`;
    entry.append(colour, Number((share * unit).toPrecision(2)).toString());
    box.append(entry);
  }
}

function showFigures(): void {
  showLegend();
  const box = element('figures');
  box.hidden = !figuresShown;
  if (!figuresShown) return;
  const { pose } = flying;
  const lines = [
    `x ${(pose.x / 256).toFixed(1)}  z ${(pose.z / 256).toFixed(1)}  y ${pose.y.toFixed(1)} m${ground === undefined ? '' : `, ${(pose.y - ground).toFixed(0)} m above ground`}`,
    `speed ${flying.speed.toFixed(0)} m/s`,
  ];
  if (figures)
    lines.push(
      `iteration ${figures.iteration}${isAtRest() ? ', settled' : ''}  hash ${figures.hashOk ? 'agrees' : 'differs'}`,
      `${count(figures.triangles)} triangles in ${figures.leaves} leaves, error ${figures.effectiveThreshold.toPrecision(3)} px`,
      `${(figures.bytes / 1e6).toFixed(2)} MB received  decoded in ${figures.decodeMs.toFixed(1)} ms  latency ${figures.latencyMs.toFixed(0)} ms`,
    );
  if (frames) lines.push(`${frames.perSecond.toFixed(0)} pictures/s  ${frames.milliseconds.toFixed(0)} ms  ${frames.finest ? 'finest' : `1 sample for ${frames.coarseness}x${frames.coarseness} px`}`);
  if (others.length > 0) lines.push(`${others.length} other${others.length > 1 ? 's' : ''} here`);
  box.textContent = lines.join('\n');
}

// ---- the server ----

function streamUrl(): string {
  const url = new URL('./v1/stream', location.href);
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
  url.hash = '';
  url.search = '';
  url.searchParams.set('session', place.session);
  if (place.terrain) url.searchParams.set('terrain', place.terrain);
  if (place.terrain && place.seed) url.searchParams.set('seed', place.seed);
  if (place.terrain) for (const parameter of place.parameters) url.searchParams.append('param', parameter);
  return url.href;
}

let asked = 0; // when a world was asked for that the server may have to compile; 0: none is waited for

function showWaiting(): void {
  const seconds = Math.floor((performance.now() - asked) / 1000);
  if (asked > 0 && seconds >= 2) light('wait', `waiting for the server to prepare the terrain, ${seconds} s`);
}

function connect(): void {
  asked = place.terrain ? performance.now() : 0;
  element('problem').hidden = true;
  toEngine({ kind: 'start', url: streamUrl(), settings: { threshold: threshold ?? 0, triangleBudget: 0, candidates: 0 }, token });
}

engine.onmessage = ({ data }: MessageEvent<FromEngine>) => {
  switch (data.kind) {
    case 'world': {
      world = data.world;
      asked = 0;
      lost = '';
      element('problem').hidden = true;
      note('', 0);
      light('on', `${world.terrain}, seed ${world.seed}${world.session === 'default' ? '' : ` · ${world.session}`}`);
      document.title = `${world.terrain} · Ridgecast`;
      if (!world.hasSource && look.mode !== 'mesh') setMode('mesh');
      for (const mode of ['march', 'split']) document.querySelector<HTMLButtonElement>(`[data-mode=${mode}]`)!.disabled = !world.hasSource;
      showThreshold(world.threshold);
      sentPose = undefined; // told again, and nothing is at rest before it is answered
      break;
    }
    case 'lost':
      lost = data.sentence;
      asked = 0;
      light(data.final ? 'off' : 'wait', data.final ? 'not connected' : 'reconnecting');
      if (data.wantsToken) problem('This server asks for a token', token ? `${data.sentence} Give another one.` : 'Ask whoever runs it for one.', 'token');
      else if (data.final) problem('Not connected', data.sentence, 'again');
      else if (figures) note(`${data.sentence} The picture shows what had arrived; trying again.`, 0);
      else problem('No connection to the server', `${data.sentence} Trying again.`, 'again');
      break;
    case 'figures':
      figures = data.figures;
      break;
    case 'ground':
      ground = data.metres;
      if (groundWanted && world && !world.hasSource) beginAbove(data.metres);
      break;
    case 'members':
      others = data.members;
      members.set(others);
      break;
  }
};
engine.onerror = (event) => problem('The page failed', `${event.message || 'Its engine could not be loaded.'} Reload it.`);

// ---- pictures ----

painter.onmessage = ({ data }: MessageEvent<FromPainter>) => {
  switch (data.kind) {
    case 'ready':
      document.body.dataset['renderer'] = data.renderer;
      break;
    case 'problem':
      if (data.fatal) problem('No pictures', data.sentence);
      else note(data.sentence, 12_000);
      break;
    case 'ground':
      beginAbove(data.metres);
      break;
    case 'frames':
      frames = data;
      break;
    case 'picture':
      keep(data.png, 'png');
      note('The picture is kept in your downloads.');
      break;
  }
};
painter.onerror = (event) => problem('No pictures', `${event.message || 'The part of the page that draws could not be loaded.'} Reload it.`);

function keep(file: Blob, extension: string): void {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(file);
  link.download = `ridgecast-${world?.terrain ?? 'view'}.${extension}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const authorization = (): Record<string, string> => (token ? { Authorization: `Bearer ${token}` } : {});

// Exactly the mesh that this page holds, from the server.
async function keepMesh(): Promise<void> {
  if (!world) return;
  note('The server writes the mesh …', 0);
  try {
    const answer = await fetch(`./v1/sessions/${world.session}/snapshot.glb?camera=${world.camera}`, { headers: authorization() });
    if (!answer.ok) throw new Error((await answer.text()).trim().slice(0, 300));
    keep(await answer.blob(), 'glb');
    note('The mesh is kept in your downloads.');
  } catch (error) {
    note(`The server gives no mesh: ${error instanceof Error ? error.message : error}`, 8000);
  }
}

// The start is given above the ground, whose height was not known until now.
function beginAbove(metres: number): void {
  if (!groundWanted) return;
  groundWanted = false;
  flying.pose = { ...flying.pose, y: metres + place.altitude };
}

function pixels(): { width: number; height: number } {
  const ratio = Math.min(devicePixelRatio || 1, Math.sqrt(MAX_PIXELS / Math.max(1, innerWidth * innerHeight)));
  return { width: Math.max(1, Math.round(innerWidth * ratio)), height: Math.max(1, Math.round(innerHeight * ratio)) };
}

function resize(): void {
  toPainter({ kind: 'size', ...pixels() });
  sentPose = undefined;
}

function setLook(): void {
  toPainter({ kind: 'look', look: { ...look } });
  for (const button of document.querySelectorAll<HTMLElement>('[data-mode]')) button.setAttribute('aria-pressed', String(button.dataset['mode'] === look.mode));
  const on: Record<string, boolean> = { wireframe: look.wireframe, nodes: look.nodes, candidates: look.candidates, figures: figuresShown };
  for (const button of document.querySelectorAll<HTMLElement>('[data-toggle]')) button.setAttribute('aria-pressed', String(on[button.dataset['toggle']!]));
  const divider = element('divider');
  divider.hidden = look.mode !== 'split';
  divider.style.left = `${look.divider * 100}%`;
  showFigures();
}

function setMode(mode: Mode): void {
  if (mode !== 'mesh' && world && !world.hasSource) return note('The server keeps the terrain to itself: there is no ray march.');
  look.mode = mode;
  setLook();
}

function toggle(name: string): void {
  if (name === 'wireframe') look.wireframe = !look.wireframe;
  else if (name === 'nodes') look.nodes = !look.nodes;
  else if (name === 'candidates') toEngine({ kind: 'candidates', wanted: (look.candidates = !look.candidates) });
  else figuresShown = !figuresShown;
  setLook();
}

function showThreshold(granted: number): void {
  const select = element<HTMLSelectElement>('threshold');
  let option = [...select.options].find((o) => Number(o.value) === granted);
  if (!option) {
    option = new Option(`${Number(granted.toPrecision(3))} px`, String(granted));
    select.add(option);
  }
  option.selected = true;
}

// ---- links and worlds ----

function address(): string {
  return new URL(writePlace({ ...place, pose: flying.pose, threshold, mode: look.mode }), location.href).href;
}

async function copyLink(): Promise<void> {
  history.replaceState(null, '', address());
  try {
    await navigator.clipboard.writeText(address());
    note('The link to this place is copied.');
  } catch {
    note('The link to this place is in the address bar.');
  }
}

window.addEventListener('hashchange', () => {
  const next = readPlace(location.hash);
  const elsewhere = next.session !== place.session || next.terrain !== place.terrain || next.threshold !== threshold;
  Object.assign(place, next);
  flying.pose = next.pose;
  threshold = next.threshold;
  if (next.token) token = next.token;
  look.mode = next.mode;
  setLook();
  if (!Number.isFinite(next.pose.y)) wantGround();
  if (elsewhere) connect();
});

function wantGround(): void {
  groundWanted = true;
  toPainter({ kind: 'ground', pose: { ...flying.pose, y: 0 } });
}

function goTo(session: string, terrain: string, seed: string): void {
  Object.assign(place, { session, terrain, seed, parameters: [] });
  element<HTMLDialogElement>('worlds').close();
  history.replaceState(null, '', address());
  light('wait', 'connecting');
  connect();
}

async function showWorlds(): Promise<void> {
  element<HTMLDialogElement>('worlds').showModal();
  const list = element('sessions');
  list.textContent = 'Asking the server …';
  try {
    const answer = await fetch('./v1/sessions', { headers: authorization() });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    const { sessions } = (await answer.json()) as { sessions: { name: string; terrain: string; seed: number; members: number }[] };
    list.replaceChildren(
      ...sessions.map((s) => {
        const item = document.createElement('li'), button = document.createElement('button');
        button.textContent = `${s.name}: ${s.terrain}, seed ${s.seed} · ${s.members} here`;
        button.disabled = s.name === world?.session;
        button.addEventListener('click', () => goTo(s.name, '', ''));
        item.append(button);
        return item;
      }),
    );
  } catch (error) {
    list.textContent = `The server does not list its sessions. ${error instanceof Error ? error.message : ''}`;
  }
}

// ---- hands ----

const hands = new Hands(canvas);
hands.attachTouch(element('stick'), element('lift'));
hands.onGrab = (x) => look.mode === 'split' && Math.abs(x - look.divider * innerWidth) < 14;
hands.onDrag = (x) => {
  look.divider = Math.min(0.98, Math.max(0.02, x / innerWidth));
  setLook();
};
const keys: Record<string, () => void> = {
  Digit1: () => setMode('mesh'),
  Digit2: () => setMode('march'),
  Digit3: () => setMode('split'),
  KeyX: () => toggle('wireframe'),
  KeyN: () => toggle('nodes'),
  KeyK: () => toggle('candidates'),
  KeyF: () => toggle('figures'),
  KeyP: () => toPainter({ kind: 'picture' }),
  KeyG: () => void keepMesh(),
  KeyL: () => void copyLink(),
  KeyH: () => element<HTMLDialogElement>('help-text').showModal(),
};
hands.onKey = (code) => keys[code]?.();
for (const button of document.querySelectorAll<HTMLElement>('[data-mode]')) button.addEventListener('click', () => setMode(button.dataset['mode'] as Mode));
for (const button of document.querySelectorAll<HTMLElement>('[data-toggle]')) button.addEventListener('click', () => toggle(button.dataset['toggle']!));
element('picture').addEventListener('click', () => keys['KeyP']!());
element('gltf').addEventListener('click', () => keys['KeyG']!());
element('link').addEventListener('click', () => keys['KeyL']!());
element('help').addEventListener('click', () => keys['KeyH']!());
element('place').addEventListener('click', () => void showWorlds());
element('again').addEventListener('click', connect);
element('token').addEventListener('submit', (event) => {
  event.preventDefault();
  token = String(new FormData(event.target as HTMLFormElement).get('token') ?? '').trim();
  sessionStorage.setItem('token', token); // of this tab alone, and not in links
  connect();
});
element('make').addEventListener('submit', (event) => {
  event.preventDefault();
  const form = new FormData(event.target as HTMLFormElement);
  goTo(String(form.get('session')), String(form.get('terrain')), String(form.get('seed')));
});
element('threshold').addEventListener('change', (event) => {
  threshold = Number((event.target as HTMLSelectElement).value);
  canvas.focus();
  connect(); // the mesh that is held is kept
});
window.addEventListener('resize', resize);
window.addEventListener('online', () => toEngine({ kind: 'hurry' }));
window.addEventListener('pagehide', () => toEngine({ kind: 'stop' }));
window.addEventListener('pageshow', (event) => {
  if (event.persisted) connect();
});

// ---- frames ----

let last = performance.now();
let sentAt = 0, sentPose: View['pose'] | undefined, drawnPose: View['pose'] | undefined, savedAt = 0;

function frame(now: number): void {
  requestAnimationFrame(frame);
  const seconds = Math.min(0.1, Math.max(0, (now - last) / 1000));
  last = now;
  const input = hands.take(seconds);
  if (groundWanted) return;
  flying.step(input, seconds, ground);
  const { pose } = flying;
  if (!drawnPose || !samePose(drawnPose, pose)) {
    drawnPose = pose;
    toPainter({ kind: 'pose', pose, verticalFov: VERTICAL_FOV });
  }
  const size = pixels();
  if (now - sentAt >= POSE_INTERVAL && (!sentPose || !samePose(sentPose, pose))) {
    sentAt = now;
    sentPose = pose;
    toEngine({ kind: 'pose', number: ++posed, camera: { x: pose.x, z: pose.z, y: pose.y, yaw: pose.yaw, pitch: pose.pitch, verticalFov: VERTICAL_FOV, ...size } });
  }
  if (now - savedAt > 2000 && seconds > 0 && samePose(pose, sentPose ?? pose)) {
    savedAt = now;
    const next = address();
    if (next !== location.href && world) history.replaceState(null, '', next);
  }
  members.draw({ pose, ...size, verticalFov: VERTICAL_FOV, horizon: world?.horizon ?? 0 }, innerWidth, innerHeight);
}
setInterval(showFigures, 250);
setInterval(showWaiting, 500);

// Whether the mesh is all that will come for this pose; what was said of an earlier pose or connection does not count.
function isAtRest(): boolean {
  return lost === '' && sentPose !== undefined && samePose(sentPose, flying.pose) && figures !== undefined && figures.settled && figures.pose === posed;
}
// Whether the picture is all that the painter will make of that.
function isDrawn(): boolean {
  return isAtRest() && frames !== undefined && frames.finest && frames.messages === painted && frames.changes === figures!.changes;
}

// What tests read.
export interface Report {
  connected: boolean;
  lost: string;
  world: WorldTold | undefined;
  figures: Figures | undefined;
  frames: typeof frames;
  atRest: boolean;
  drawn: boolean;
  others: MemberTold[];
  pose: View['pose'];
}
(globalThis as unknown as { ridgecast: Report }).ridgecast = {
  get connected() {
    return lost === '' && world !== undefined;
  },
  get lost() {
    return lost;
  },
  get world() {
    return world;
  },
  get figures() {
    return figures;
  },
  get frames() {
    return frames;
  },
  get others() {
    return others;
  },
  get atRest() {
    return isAtRest();
  },
  get drawn() {
    return isDrawn();
  },
  get pose() {
    return flying.pose;
  },
};

// ---- the beginning ----

function begin(): void {
  if (!('transferControlToOffscreen' in canvas) || typeof OffscreenCanvas === 'undefined')
    return problem('This browser is too old', 'The viewer draws in a worker (OffscreenCanvas), which Chrome 69, Firefox 105 and Safari 17 and those after them can.');
  const offscreen = canvas.transferControlToOffscreen();
  const between = new MessageChannel();
  toEngine({ kind: 'painter', port: between.port1 }, [between.port1]);
  toPainter({ kind: 'begin', canvas: offscreen, engine: between.port2 }, [offscreen, between.port2]);
  resize();
  setLook();
  if (groundWanted) wantGround();
  connect();
  canvas.focus({ preventScroll: true });
  requestAnimationFrame(frame);
}
begin();
