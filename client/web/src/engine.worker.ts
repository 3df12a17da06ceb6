// The engine: holds the connection and the mesh, away from the page's thread. Iterations are decoded, compared with the server's hash
// and turned into buffers here; the painter takes them over a port of its own.

import dracoFactory from 'draco3d/draco_decoder_nodejs.js';
import dracoUrl from 'draco3d/draco_decoder.wasm?url';
import { DracoFactory, loadDraco } from './codec/draco';
import type { DracoDecode } from './codec/leaf';
import { Refusal, keyOf } from './codec/mesh';
import type { Iteration, Members, Moved, World } from './generated/ridgecast/v1/stream_pb';
import type { FromEngine, FromPainterToEngine, LeafBuffers, MemberTold, ToEngine, ToPainterFromEngine } from './messages';
import { Change, HeldLeaf, Scene } from './scene/scene';
import { Camera, Explanation, Held, Settings, Socket, Stream } from './stream/stream';

const page = self as unknown as { postMessage(message: FromEngine): void; onmessage: ((event: MessageEvent<ToEngine>) => void) | null };
const MOST_CANDIDATES = 20_000; // of an iteration
const MAKING_PATIENCE = 90_000; // ms; a browser hides that the server says it is at it
const text = (bytes: Uint8Array): string => new TextDecoder().decode(bytes);

let painter: MessagePort | undefined;
let stream: Stream | undefined;
let scene: Scene | undefined;
let contentHash: bigint | undefined;
let camera: Camera | undefined;
let posed = 0; // the number of the page's newest pose
let told: Extract<FromEngine, { kind: 'figures' }> | undefined;
let candidatesWanted = false, candidateCount = 0;
let settings: Settings = { threshold: 0, triangleBudget: 0, candidates: 0 };
let generation = 0; // of connections: what an older one is owed is never said
const untaken: (() => void)[] = []; // acknowledgements that wait for the painter, as many as the server's window at most
const sent = new Map<bigint, number>(); // poses and when they were sent
const members = new Map<string, MemberTold>();
const totals = { bytes: 0, decoded: 0, hashes: 0, mismatches: 0, changes: 0 };

function buffersOf(leaf: HeldLeaf): LeafBuffers {
  const { vertices, triangles } = leaf.mesh;
  const corners = new Int32Array(3 * triangles.length);
  for (let k = 0, at = 0; k < triangles.length; ++k, at += 3) {
    const v = 3 * triangles[k]!;
    corners[at] = vertices[v]!;
    corners[at + 1] = vertices[v + 1]!;
    corners[at + 2] = vertices[v + 2]!;
  }
  return { key: keyOf(leaf.mesh.address), address: leaf.mesh.address, corners, low: leaf.low, high: leaf.high };
}

function toPainter(message: ToPainterFromEngine, transfer: Transferable[] = []): void {
  painter?.postMessage(message, transfer);
}

function show(change: Change, clear: boolean, then: () => void): void {
  const fresh = change.fresh.map(buffersOf);
  untaken.push(then);
  ++totals.changes;
  toPainter(
    { kind: 'change', gone: change.gone.map(keyOf), fresh, clear },
    fresh.map((leaf) => leaf.corners.buffer as ArrayBuffer),
  );
}

function begin(world: World): Held[] {
  const held = scene!;
  sent.clear();
  ++generation;
  members.clear();
  candidateCount = 0;
  toPainter({ kind: 'candidates', candidates: undefined });
  const source = text(world.terrainSource);
  if (contentHash !== undefined && contentHash !== world.contentHash) {
    held.clear();
    show({ gone: [], fresh: [], decoded: 0 }, true, () => {});
  }
  contentHash = world.contentHash;
  held.reconnect();
  toPainter({ kind: 'world', source, seed: world.seed, horizon: world.horizon });
  page.postMessage({
    kind: 'world',
    world: {
      terrain: text(world.terrainName),
      seed: world.seed,
      session: text(world.session),
      server: text(world.serverName),
      camera: String(world.camera),
      horizon: world.horizon,
      hasSource: source !== '',
      threshold: world.settings?.threshold ?? 0,
      triangleBudget: world.settings?.triangleBudget ?? 0,
    },
  });
  return [...held.leaves.values()].map((leaf) => ({ address: leaf.mesh.address, hash: leaf.hash }));
}

function take(from: Stream, held: Scene, iteration: Iteration, bytes: number): void {
  const began = performance.now();
  let change: Change;
  try {
    change = held.apply(iteration);
  } catch (error) {
    // Cannot be mended over this connection: drop everything, and let the stream come back.
    if (error instanceof Refusal) held.clear(), show({ gone: [], fresh: [], decoded: 0 }, true, () => {});
    throw error;
  }
  const same = held.hash === iteration.meshHash;
  totals.bytes += bytes;
  totals.decoded += change.decoded;
  ++totals.hashes;
  if (held.damaged) {
    const damaged = held.takeDamaged();
    if (damaged.length > 0) from.resend(damaged);
  } else if (!same) {
    ++totals.mismatches;
    from.resend([]);
  }
  const { hash } = held, mine = generation;
  tellCandidates(iteration); // before the change, which the painter counts
  show(change, false, () => {
    if (mine === generation) from.acknowledge(iteration.number, hash);
  });
  const at = sent.get(iteration.poseSequence);
  for (const sequence of sent.keys()) if (sequence <= iteration.poseSequence) sent.delete(sequence);
  told = {
    kind: 'figures',
    figures: {
      iteration: Number(iteration.number),
      triangles: held.triangles,
      leaves: held.leaves.size,
      settled: iteration.settled && same && sent.size === 0,
      pose: posed,
      hashOk: same,
      effectiveThreshold: iteration.figures?.effectiveThreshold ?? 0,
      ...totals,
      candidates: candidateCount,
      decodeMs: performance.now() - began,
      latencyMs: at === undefined ? 0 : performance.now() - at,
    },
  };
  page.postMessage(told);
  tellGround();
}

function know(told: Members): void {
  const at = (moved: Moved | undefined): MemberTold['at'] => moved?.pose && { x: Number(moved.pose.x), y: moved.pose.y, z: Number(moved.pose.z) };
  for (const camera of told.left) members.delete(String(camera));
  for (const { camera, name, moved } of told.joined) members.set(String(camera), { camera: String(camera), name: text(name), at: at(moved) });
  for (const moved of told.moved) {
    const member = members.get(String(moved.camera));
    if (member) member.at = at(moved);
  }
  page.postMessage({ kind: 'members', members: [...members.values()] });
}

function tellCandidates({ candidates, figures }: Iteration): void {
  if (!candidatesWanted || !candidates) return;
  const { x, z, points, errors } = candidates;
  candidateCount = Math.min(errors.length, Math.floor(points.length / 3));
  const own = { x: Number(x), z: Number(z), points: Int32Array.from(points.slice(0, 3 * candidateCount)), errors: Float32Array.from(errors.slice(0, candidateCount)) };
  toPainter({ kind: 'candidates', candidates: { ...own, threshold: Math.max(figures?.effectiveThreshold ?? 0, 1e-3) } }, [own.points.buffer, own.errors.buffer]);
}

function wantCandidates(wanted: boolean): void {
  candidatesWanted = wanted;
  candidateCount = 0;
  settings = { ...settings, candidates: wanted ? MOST_CANDIDATES : 0 };
  stream?.change(settings);
  if (wanted) return;
  toPainter({ kind: 'candidates', candidates: undefined });
  if (told) page.postMessage((told = { ...told, figures: { ...told.figures, candidates: 0 } }));
}

function tellGround(): void {
  const metres = camera && scene?.height(camera.x, camera.z);
  if (metres !== undefined) page.postMessage({ kind: 'ground', metres });
}

// A browser does not say why a WebSocket could not be opened; the same address over HTTP does.
async function explain(url: string, token: string): Promise<Explanation | undefined> {
  try {
    const answer = await fetch(url.replace(/^ws/, 'http'), { cache: 'no-store', headers: token ? { Authorization: `Bearer ${token}` } : {} });
    const sentence = (await answer.text()).trim().slice(0, 500);
    // 426: all is well over HTTP, so it is the session that refused.
    if (answer.status === 426) return { sentence: 'The server is there but refuses this session: it does not exist, is another world or is full.', final: false, wantsToken: false };
    return { sentence, final: [400, 401, 403, 404, 409, 421].includes(answer.status), wantsToken: answer.status === 401 };
  } catch {
    return undefined;
  }
}

async function loaded(): Promise<DracoDecode> {
  const wasm = await fetch(dracoUrl);
  if (!wasm.ok) throw new Error(`the decoder cannot be loaded (${wasm.status})`);
  return loadDraco(dracoFactory as unknown as DracoFactory, await wasm.arrayBuffer());
}

async function start(message: Extract<ToEngine, { kind: 'start' }>): Promise<void> {
  stream?.close();
  stream = undefined;
  if (!scene) {
    try {
      scene = new Scene(await loaded());
    } catch (error) {
      page.postMessage({ kind: 'lost', sentence: `The page could not load its parts: ${error instanceof Error ? error.message : error}. Reload it.`, final: true, wantsToken: false });
      return;
    }
  }
  const held = scene;
  settings = { ...message.settings, candidates: candidatesWanted ? MOST_CANDIDATES : 0 };
  const own = new Stream(
    {
      // A page cannot set headers of a WebSocket: a token travels as a subprotocol.
      open: () => new WebSocket(message.url, message.token ? ['ridgecast.v1', `bearer.${message.token}`] : []) as unknown as Socket,
      clientName: 'ridgecast-web',
      settings,
      ...(new URL(message.url).searchParams.has('terrain') ? { patience: MAKING_PATIENCE } : {}),
      explain: () => explain(message.url, message.token),
    },
    {
      onWorld: begin,
      onIteration: (iteration, bytes) => take(own, held, iteration, bytes),
      onMembers: know,
      onLost: (sentence, final, wantsToken) => {
        members.clear();
        page.postMessage({ kind: 'members', members: [] });
        page.postMessage({ kind: 'lost', sentence, final, wantsToken });
      },
    },
  );
  stream = own;
  if (camera) own.pose(camera);
}

page.onmessage = ({ data }) => {
  switch (data.kind) {
    case 'painter':
      painter = data.port;
      painter.onmessage = (event: MessageEvent<FromPainterToEngine>) => {
        if (event.data.kind === 'taken') untaken.shift()?.();
      };
      break;
    case 'start':
      void start(data);
      break;
    case 'pose': {
      camera = data.camera;
      posed = data.number;
      const sequence = stream?.pose(data.camera) ?? 0n;
      if (sequence > 0n) {
        sent.set(sequence, performance.now());
        if (sent.size > 256) sent.delete(sent.keys().next().value!);
      }
      tellGround();
      break;
    }
    case 'candidates':
      wantCandidates(data.wanted);
      break;
    case 'hurry':
      stream?.hurry();
      break;
    case 'stop':
      stream?.close();
      break;
  }
};
