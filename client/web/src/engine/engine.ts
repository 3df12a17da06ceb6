// Holds the connection and the mesh. Iterations are decoded, compared with the server's hash and turned into buffers here; the painter
// takes them over a port of its own.

import type { DracoDecode } from '../codec/leaf';
import type { HeightMap, Iteration, World } from '../generated/ridgecast/v1/stream_pb';
import type { Figures, FromEngine, ToEngine, WorldTold } from '../messages';
import { Replica } from '../replica/replica';
import { touch } from '../scene/touch';
import { Held, Loss, Settings, Socket, Stream, jumpsClock, takesEdits, tellsEdits } from '../stream/stream';
import { HeldEdits } from './held_edits';
import { MemberList } from './member_list';
import { PainterPort } from './painter_port';
import { Poses } from './poses';

type Start = Extract<ToEngine, { kind: 'start' }>;

const MOST_CANDIDATES = 20_000; // of an iteration
const MAKING_TIMEOUT = 90_000; // ms; a browser hides that the server says it is at it
const text = (bytes: Uint8Array): string => new TextDecoder().decode(bytes);

// A browser does not say why a WebSocket could not be opened; the same address over HTTP does.
async function explain(url: string, token: string): Promise<Loss | undefined> {
  try {
    const answer = await fetch(url.replace(/^ws/, 'http'), { cache: 'no-store', headers: token ? { Authorization: `Bearer ${token}` } : {} });
    // 426: the server would open the stream now.
    if (answer.status === 426) return { sentence: 'The server answers, but the connection ended before it began.', final: false, wantsToken: false };
    const sentence = (await answer.text()).trim().slice(0, 500) || `The server answers with status ${answer.status}.`;
    return { sentence, final: answer.status >= 400 && answer.status < 500, wantsToken: answer.status === 401 };
  } catch {
    return undefined;
  }
}

export interface Parts {
  readonly draco: DracoDecode;
  readonly points: WebAssembly.Module; // of scene/point_mesh.ts
}

function areaOf({ originX, originZ, pitchX, pitchZ, width, height }: HeightMap): WorldTold['map'] {
  const last = (origin: bigint, pitch: bigint, count: number): number => Number(origin + ((pitch * BigInt(count - 1)) >> 20n));
  return { x0: Number(originX), z0: Number(originZ), x1: last(originX, pitchX, width), z1: last(originZ, pitchZ, height) };
}

export class Engine {
  private readonly painter = new PainterPort();
  private readonly poses = new Poses();
  private readonly members = new MemberList();
  private parts: Promise<Parts> | undefined; // load from the first message on
  private replica: Replica | undefined;
  private stream: Stream | undefined;
  private starts = 0;
  private settings: Settings = { threshold: 0, candidates: 0 };
  private candidates = 0; // of the last iteration
  private bytes = 0;
  private figures: Figures | undefined;
  private edits: HeldEdits | undefined; // of a world that tells them
  private editsOf = ''; // its session
  private meshIsSettled = false;

  constructor(
    private readonly tell: (message: FromEngine) => void,
    private readonly loadParts: () => Promise<Parts>,
  ) {}

  /** What the page says. */
  hear(message: ToEngine): void {
    switch (message.kind) {
      case 'painter':
        this.load().catch(() => {}); // start() says so
        return this.painter.open(message.port);
      case 'start':
        return void this.start(message);
      case 'pose':
        this.poses.newest = message.camera;
        this.poses.number = message.number;
        this.poses.add(this.stream?.pose(message.camera) ?? 0n);
        this.followEdits();
        return this.tellGround();
      case 'candidates':
        return this.wantCandidates(message.wanted);
      case 'threshold':
        this.settings = { ...this.settings, threshold: message.pixels };
        return this.stream?.change(this.settings);
      case 'edit':
        return this.stream?.edit(message.id, message.key, message.operation);
      case 'brush':
        return this.tell({ kind: 'touched', number: message.brush.number, touched: this.replica && touch(this.replica.scene, message.brush) });
      case 'set clock':
        return this.stream?.setClock(message.set.rate, message.set.time, message.set.number);
      case 'hurry':
        return this.stream?.hurry();
      case 'stop':
        ++this.starts; // also of one that has not begun
        return this.stream?.close();
    }
  }

  private async start({ url, token, settings, name }: Start): Promise<void> {
    this.stream?.close();
    this.stream = undefined;
    const mine = ++this.starts;
    try {
      const { draco, points } = await this.load();
      this.replica ??= new Replica(draco, points);
    } catch (error) {
      this.parts = undefined;
      return this.lost({ sentence: `The page could not load its parts: ${error instanceof Error ? error.message : error}. Reload it.`, final: true, wantsToken: false });
    }
    if (mine !== this.starts) return; // started again meanwhile
    this.settings = { ...settings, candidates: this.settings.candidates };
    this.stream = new Stream(
      {
        // A page cannot set headers of a WebSocket: a token travels as a subprotocol.
        open: () => new WebSocket(url, token ? ['ridgecast.v1', `bearer.${token}`] : []) as unknown as Socket,
        clientName: name,
        settings: this.settings,
        ...(new URL(url).searchParams.has('terrain') ? { timeout: MAKING_TIMEOUT } : {}),
        explain: () => explain(url, token),
      },
      {
        onWorld: (world) => this.enter(world),
        onIteration: (iteration, bytes) => this.take(iteration, bytes),
        onMembers: (members) => {
          this.members.know(members);
          this.tellMembers();
        },
        onGranted: (granted) => this.tell({ kind: 'granted', threshold: granted.threshold }),
        onClock: (clock) => {
          const { rate, time, end, owner, echo } = clock, at = performance.timeOrigin + performance.now();
          this.tell({ kind: 'clock', clock: { time: Number(time), at, rate, end: Number(end), owner: String(owner), answers: Number(echo) } });
          if (clock.notice.length > 0) this.tell({ kind: 'notice', sentence: text(clock.notice) });
        },
        onEditAnswer: ({ id, number, refusal }) => this.tell({ kind: 'edit answer', id: Number(id), number: Number(number), refusal: text(refusal) }),
        onFoundEdits: (found) => {
          this.edits?.found(found);
          this.followEdits();
        },
        onSquares: (squares) => {
          this.edits?.put(squares);
          this.followEdits();
        },
        onLost: (loss) => this.lost(loss),
      },
    );
    if (this.poses.newest) this.stream.pose(this.poses.newest);
  }

  private load(): Promise<Parts> {
    return (this.parts ??= this.loadParts());
  }

  private enter(world: World): Held[] {
    this.poses.forget();
    this.members.clear();
    this.showNoCandidates();
    const held = this.replica!.resume(world, this.stream!);
    if (held.length === 0) this.painter.clear();
    const source = world.heightMap ? '' : text(world.terrainSource); // which needs samples that the page does not ask for
    this.enterEdits(world, source);
    this.painter.send({ kind: 'world', source, seed: world.seed, horizon: world.horizon });
    this.tell({
      kind: 'world',
      world: {
        terrain: text(world.terrainName),
        seed: world.seed,
        session: text(world.session),
        camera: String(world.camera),
        lacks: source ? '' : world.heightMap ? 'This page has no samples of a height map' : 'The server keeps the terrain to itself',
        threshold: world.settings?.threshold ?? 0,
        takesEdits: takesEdits(world),
        jumpsClock: jumpsClock(world),
        map: world.heightMap && areaOf(world.heightMap),
      },
    });
    return held;
  }

  private take(iteration: Iteration, bytes: number): void {
    const began = performance.now(), { scene, totals } = this.replica!;
    const applied = this.replica!.apply(iteration);
    this.edits?.know(iteration.edit);
    this.bytes += bytes;
    this.showCandidates(iteration); // before the change, which the painter counts
    this.painter.show(applied, applied.acknowledge);
    const latencyMs = this.poses.answered(iteration.poseSequence);
    this.tellFigures({
      iteration: Number(iteration.number),
      triangles: scene.triangles,
      leaves: scene.leaves.size,
      settled: (this.meshIsSettled = iteration.settled && applied.agrees && this.poses.allAnswered) && this.hasAllEdits,
      edit: Number(iteration.edit),
      pose: this.poses.number,
      changes: this.painter.changes,
      hashOk: applied.agrees,
      effectiveThreshold: iteration.figures?.effectiveThreshold ?? 0,
      bytes: this.bytes,
      ...totals,
      candidates: this.candidates,
      decodeMs: performance.now() - began,
      latencyMs,
    });
    this.followEdits();
    this.tellGround();
  }

  /** Asks for what is lacking of the edits around the camera, and hands over what has come. */
  private followEdits(): void {
    const { edits, stream } = this, { newest } = this.poses;
    if (!edits || !stream || !newest) return;
    edits.moveTo(newest.x, newest.z);
    const { find, want } = edits.take();
    if (find) stream.findEdits(find.x, find.z, find.radius, find.since);
    if (want.length > 0) stream.wantSquares(want);
    const { fresh, gone } = edits.changes();
    if (fresh.length > 0 || gone.length > 0) this.painter.showSquares(gone, fresh);
    const { figures, painter } = this, settled = this.meshIsSettled && this.hasAllEdits;
    if (figures && (figures.changes !== painter.changes || figures.settled !== settled)) this.tellFigures({ ...figures, changes: painter.changes, settled });
  }
  private get hasAllEdits(): boolean {
    return this.edits?.complete ?? true;
  }
  private enterEdits(world: World, source: string): void {
    const of = source && tellsEdits(world) ? `${world.contentHash} ${text(world.session)}` : '';
    if (this.edits && of === this.editsOf) return this.edits.reconnected(world.edit);
    const held = this.edits?.all ?? [];
    if (held.length > 0) this.painter.showSquares(held, []);
    this.edits = of ? new HeldEdits(world.horizon) : undefined;
    this.editsOf = of;
    this.edits?.know(world.edit);
  }

  private lost(loss: Loss): void {
    this.members.clear();
    this.tellMembers();
    this.tell({ kind: 'lost', ...loss });
  }

  private wantCandidates(wanted: boolean): void {
    this.settings = { ...this.settings, candidates: wanted ? MOST_CANDIDATES : 0 };
    this.stream?.change(this.settings);
    if (wanted) return;
    this.showNoCandidates();
    if (this.figures) this.tellFigures({ ...this.figures, candidates: 0 });
  }

  private showNoCandidates(): void {
    this.candidates = 0;
    this.painter.send({ kind: 'candidates', candidates: undefined });
  }

  private showCandidates({ candidates, figures }: Iteration): void {
    if (this.settings.candidates === 0 || !candidates) return;
    const { x, z, points, errors } = candidates;
    const count = (this.candidates = Math.min(errors.length, Math.floor(points.length / 3)));
    const own = { x: Number(x), z: Number(z), points: Int32Array.from(points.slice(0, 3 * count)), errors: Float32Array.from(errors.slice(0, count)) };
    this.painter.send({ kind: 'candidates', candidates: { ...own, threshold: Math.max(figures?.effectiveThreshold ?? 0, 1e-3) } }, [own.points.buffer, own.errors.buffer]);
  }

  private tellFigures(figures: Figures): void {
    this.figures = figures;
    this.tell({ kind: 'figures', figures });
  }
  private tellMembers(): void {
    this.tell({ kind: 'members', members: this.members.all });
  }
  private tellGround(): void {
    const { newest } = this.poses;
    const metres = newest && this.replica?.scene.height(newest.x, newest.z);
    if (metres !== undefined) this.tell({ kind: 'ground', metres });
  }
}
