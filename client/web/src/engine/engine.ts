// The worker's half of a client: it loads the core, and carries what the core, the page and the painter say to each other.

import { Core } from '../core/core';
import type { DracoDecode } from '../core/draco';
import type { FromEngine, FromPainterToEngine, Loss, ToEngine } from '../messages';
import { Line, type Socket } from './line';

type Start = Extract<ToEngine, { kind: 'start' }>;
type Posed = Extract<ToEngine, { kind: 'pose' }>;

const MAKING_TIMEOUT = 90_000; // ms; a browser hides that the server says it is at it

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
  readonly core: WebAssembly.Module;
}

export class Engine {
  private parts: Promise<Parts> | undefined; // load from the first message on
  private core: Core | undefined;
  private line: Line | undefined;
  private painter: MessagePort | undefined;
  private starts = 0;
  private posed: Posed | undefined; // the newest
  private wantsCandidates = false;
  private readonly decoding = { iteration: 0, milliseconds: 0 }; // of the last iteration

  constructor(
    private readonly tell: (message: FromEngine) => void,
    private readonly loadParts: () => Promise<Parts>,
  ) {}

  /** What the page says. */
  hear(message: ToEngine): void {
    switch (message.kind) {
      case 'painter':
        this.load().catch(() => {}); // start() says so
        this.painter = message.port;
        this.painter.onmessage = ({ data }: MessageEvent<FromPainterToEngine>) => data.kind === 'taken' && this.say((core) => core.taken());
        return;
      case 'start':
        return void this.start(message);
      case 'pose':
        this.posed = message;
        return this.say((core) => core.pose(message.camera, message.number));
      case 'candidates':
        this.wantsCandidates = message.wanted;
        return this.say((core) => core.candidates(message.wanted));
      case 'threshold':
        return this.say((core) => core.threshold(message.pixels));
      case 'edit':
        return void this.make().then(() => this.say((core) => core.edit(message.id, message.operation)), () => {}); // start() says so
      case 'brush':
        return this.core ? this.say((core) => core.brush(message.brush)) : this.tell({ kind: 'touched' });
      case 'act':
        return this.say((core) => core.act(message.act, message.by));
      case 'heights': {
        const metres = this.core?.heights(message.places) ?? message.places.filter((_, k) => k % 2 === 0).fill(NaN);
        return this.tell({ kind: 'heights', number: message.number, metres });
      }
      case 'set clock':
        return this.say((core) => core.setClock(message.rate, message.time));
      case 'drive':
        return this.say((core) => core.drive(message.drive, message.to));
      case 'hurry':
        return this.say((core) => core.hurry());
      case 'stop':
        ++this.starts; // also of one that has not begun
        return this.stop();
    }
  }

  private async start(message: Start): Promise<void> {
    this.stop();
    const mine = ++this.starts;
    try {
      await this.make();
      if (mine !== this.starts) return; // started again meanwhile
    } catch (error) {
      this.parts = undefined;
      return this.tell({ kind: 'lost', sentence: `The page could not load its parts: ${error instanceof Error ? error.message : error}. Reload it.`, final: true, wantsToken: false });
    }
    const { url, token, name, threshold } = message, { origin, pathname, search, searchParams } = new URL(url);
    this.line = new Line(this.core!, {
      // A page cannot set headers of a WebSocket: a token travels as a subprotocol.
      open: (elsewhere, showsToken) => new WebSocket((elsewhere || origin) + pathname + search, token && showsToken ? ['ridgecast.v1', `bearer.${token}`] : []) as unknown as Socket,
      onLost: (loss) => this.tell({ kind: 'lost', ...loss }),
      onSilence: (isSilent) => this.tell({ kind: 'silence', isSilent }),
      explain: () => explain(url, token),
      ...(searchParams.has('terrain') ? { timeout: MAKING_TIMEOUT } : {}),
    });
    this.say((core) => core.start(origin, name, threshold));
  }
  private stop(): void {
    this.line?.close();
    this.line = undefined;
    this.core?.stop();
  }
  private load(): Promise<Parts> {
    return (this.parts ??= this.loadParts());
  }

  private async make(): Promise<void> {
    const { draco, core: module } = await this.load();
    if (this.core) return;
    const core = (this.core = new Core(module, draco, {
      dial: (elsewhere, showsToken) => this.line?.dial(elsewhere, showsToken),
      send: (frame) => this.line?.send(frame),
      hangUp: (why) => this.line?.hangUp(why),
      tell: (message) => this.tell(message.kind === 'figures' ? this.timed(message) : message),
      paint: (message, transfer) => this.painter?.postMessage(message, transfer),
    }));
    if (this.posed) core.pose(this.posed.camera, this.posed.number);
    core.candidates(this.wantsCandidates);
  }

  private say(what: (core: Core) => void): void {
    if (!this.core) return;
    what(this.core);
    this.line?.go();
  }

  /** The core has failed: its memory ended. */
  failed(): void {
    this.line?.close();
    this.line = this.core = undefined;
    this.tell({ kind: 'lost', sentence: 'The mesh does not fit into memory.', final: true, wantsToken: false });
  }

  private timed(message: Extract<FromEngine, { kind: 'figures' }>): FromEngine {
    const { figures } = message, { decoding } = this;
    if (figures.iteration !== decoding.iteration) Object.assign(decoding, { iteration: figures.iteration, milliseconds: performance.now() - this.line!.heardAt });
    return { ...message, figures: { ...figures, decodeMs: decoding.milliseconds } };
  }
}
