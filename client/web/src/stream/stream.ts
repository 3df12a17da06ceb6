// One connection to a server: hello, resume, poses and acknowledgements out, worlds and iterations in. PROTOCOL.md, The conversation.
// Comes back by itself after a loss, waiting longer after each failure and by chance.

import { create, fromBinary, toBinary } from '@bufbuild/protobuf';
import { AcknowledgeSchema, AskClockSchema, ClientMessage, ClientMessageSchema, Clock, ClockMode, EditAnswer, EditSchema, Error_Code, FindEditsSchema, FoundEdits, HelloSchema, Iteration, Members, Metric, Pacing, PoseSchema, ResendLeavesSchema, ResumeSchema, ServerMessageSchema, SetClockSchema, Settings as WireSettings, SettingsSchema, Squares, StepDoneSchema, WantSquaresSchema, World } from '../generated/ridgecast/v1/stream_pb';
import { LeafAddress, Refusal } from '../codec/mesh';

export const PROTOCOL_VERSION = 1;
const FIRST_WAIT = 50, LONGEST_WAIT = 2000; // ms
const TIMEOUT = 15_000; // ms from the attempt to the world, unless told otherwise
const MAX_MESSAGE = 256 * 2 ** 20;
const RESUMED_AT_A_TIME = 2048, MAX_RESUMED = 65_536;

/** A camera in protocol units: steps, metres, radians, pixels. */
export interface Camera {
  x: number; // whole steps
  z: number;
  y: number;
  yaw: number;
  pitch: number;
  verticalFov: number;
  width: number;
  height: number;
}

export interface Settings {
  threshold: number; // pixels; 0: the server's default
  candidates: number; // for vertices, of an iteration at most; 0: none
}

export interface Held {
  address: LeafAddress;
  hash: bigint;
}

/** What a stream needs of a WebSocket. */
export interface Socket {
  binaryType: string;
  onopen: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  onclose: ((event: { code: number; reason: string }) => void) | null;
  send(bytes: Uint8Array): void;
  close(code?: number): void;
}

export interface Listener {
  /** A connection has begun. What is still held of the last one, to be resumed; empty: nothing. */
  onWorld(world: World): Held[];
  /** Must end in acknowledge(). A Refusal that is thrown ends the connection. */
  onIteration(iteration: Iteration, bytes: number): void;
  onLost(loss: Loss): void;
  /** Who else is in the session, and who came, moved and went since. */
  onMembers?(members: Members): void;
  /** What the server granted of change(). */
  onGranted?(granted: WireSettings): void;
  /** Follows the session's clock: no step waits for more than the answer to it. */
  onClock?(clock: Clock): void;
  /** What became of edit(). */
  onEditAnswer?(answer: EditAnswer): void;
  /** The answers to findEdits() and wantSquares(). */
  onFoundEdits?(found: FoundEdits): void;
  onSquares?(squares: Squares): void;
}

/** Why there is no connection. */
export interface Loss {
  sentence: string; // for a person
  final: boolean; // else it will be tried again
  wantsToken: boolean;
}

export interface Options {
  open: () => Socket;
  clientName: string;
  settings: Settings;
  lockstep?: boolean;
  /** Milliseconds from an attempt to the world: more where the server may have to compile it first. */
  timeout?: number;
  /** Why a connection could not even be opened, where that can be found out; sockets do not say. */
  explain?: () => Promise<Loss | undefined>;
}

const text = (bytes: Uint8Array): string => new TextDecoder().decode(bytes);
const wireAddress = (a: LeafAddress): { level: number; i: bigint; j: bigint } => ({ level: a.level, i: BigInt(a.i), j: BigInt(a.j) });

export const jumpsClock = (world: World): boolean => world.revision >= 6;
export const takesEdits = (world: World): boolean => world.revision >= 4;
/** Whether a world tells the posts of its edits: not where the terrain is private. */
export const tellsEdits = (world: World): boolean => world.revision >= 5 && world.terrainSource.length > 0;

export class Stream {
  private socket: Socket | undefined;
  private world: World | undefined;
  private settings: Settings;
  private sequence = 0n;
  private step = 0n; // the clock's newest
  private camera: Camera | undefined; // the newest, sent again to the next connection
  private wait = FIRST_WAIT;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private watchdog: ReturnType<typeof setTimeout> | undefined;
  private over = false;
  private why = ''; // what the server said before it hung up
  private final = false;

  constructor(
    private readonly options: Options,
    private readonly listener: Listener,
  ) {
    this.settings = options.settings;
    this.connect();
  }

  /** For good. */
  close(): void {
    this.over = true;
    clearTimeout(this.timer);
    clearTimeout(this.watchdog);
    const socket = this.socket;
    this.forget();
    socket?.close(1000);
  }

  /** Try again now, without waiting. */
  hurry(): void {
    if (this.over || this.socket) return;
    clearTimeout(this.timer);
    this.wait = FIRST_WAIT;
    this.connect();
  }

  /** The pose's sequence; 0 while there is no connection: it is then sent when there is one. */
  pose(camera: Camera): bigint {
    this.camera = camera;
    if (!this.world) return 0n;
    const pose = create(PoseSchema, { ...camera, sequence: ++this.sequence, x: BigInt(camera.x), z: BigInt(camera.z) });
    this.send({ case: 'pose', value: pose });
    return this.sequence;
  }

  acknowledge(iteration: bigint, meshHash: bigint): void {
    this.wait = FIRST_WAIT;
    this.send({ case: 'acknowledge', value: create(AcknowledgeSchema, { iteration, meshHash }) });
  }

  /** From the next iteration on, and of the next connections; a server that changes nothing on the way stays as it is until then. */
  change(settings: Settings): void {
    this.settings = settings;
    if (this.world && this.world.revision >= 2) this.send({ case: 'changeSettings', value: create(SettingsSchema, { metric: Metric.PIXELS, ...this.settings }) });
  }

  /** Operation: JSON. Sent once: an edit whose answer does not come is lost with the connection, and may be made all the same. */
  edit(id: number, key: string, operation: string): void {
    const bytes = (s: string): Uint8Array => new TextEncoder().encode(s);
    if (this.world && takesEdits(this.world)) this.send({ case: 'edit', value: create(EditSchema, { id: BigInt(id), key: bytes(key), operation: bytes(operation) }) });
  }

  /** Takes the clock for as long as that takes. Rate 0: it stands; time: microseconds, 0: no jump. The Clock that echoes `number` knows it. */
  setClock(rate: number, time: number, number: number): void {
    const mode = rate === 0 ? ClockMode.CLOCK_STEPPED : rate === 1 ? ClockMode.CLOCK_REAL_TIME : ClockMode.CLOCK_SCALED;
    for (const own of [true, false]) this.send({ case: 'setClock', value: create(SetClockSchema, { own, mode, rate, time: BigInt(time) }) });
    this.send({ case: 'askClock', value: create(AskClockSchema, { echo: BigInt(number) }) });
  }

  /** Only where the world tellsEdits(). */
  findEdits(x: number, z: number, radius: number, since: bigint): void {
    this.send({ case: 'findEdits', value: create(FindEditsSchema, { x: BigInt(x), z: BigInt(z), radius, since }) });
  }
  wantSquares(squares: { i: bigint; j: bigint }[]): void {
    this.send({ case: 'wantSquares', value: create(WantSquaresSchema, { squares }) });
  }

  /** All leaves. */
  resend(): void {
    this.send({ case: 'resendLeaves', value: create(ResendLeavesSchema) });
  }

  private send(kind: ClientMessage['kind']): void {
    this.socket?.send(toBinary(ClientMessageSchema, create(ClientMessageSchema, { kind })));
  }

  private connect(): void {
    this.why = '';
    let socket: Socket;
    try {
      socket = this.options.open();
    } catch (error) {
      this.over = true;
      this.listener.onLost({ sentence: String(error), final: true, wantsToken: false });
      return;
    }
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => this.hello();
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = (event) => void this.lost(event.code, event.reason);
    this.watchdog = setTimeout(() => {
      this.why = 'The server did not answer in time.';
      this.socket?.close();
      void this.lost(1006, '');
    }, this.options.timeout ?? TIMEOUT);
  }

  private hello(): void {
    const { lockstep } = this.options;
    this.send({
      case: 'hello',
      value: create(HelloSchema, {
        protocolVersion: PROTOCOL_VERSION,
        clientName: new TextEncoder().encode(this.options.clientName),
        settings: create(SettingsSchema, { metric: Metric.PIXELS, ...this.settings }),
        pacing: lockstep ? Pacing.LOCKSTEP : Pacing.FREE,
        points: true,
        members: this.listener.onMembers !== undefined,
        clock: this.listener.onClock !== undefined,
      }),
    });
  }

  private receive(data: unknown): void {
    if (!this.socket) return;
    try {
      if (!(data instanceof ArrayBuffer) || data.byteLength > MAX_MESSAGE) throw new Refusal('a message that is not binary, or too large');
      const { kind } = fromBinary(ServerMessageSchema, new Uint8Array(data));
      if (kind.case === 'world') this.begin(kind.value);
      else if (kind.case === 'iteration' && this.world) this.listener.onIteration(kind.value, data.byteLength);
      else if (kind.case === 'members' && this.world) this.listener.onMembers?.(kind.value);
      else if (kind.case === 'granted' && this.world) this.listener.onGranted?.(kind.value);
      else if (kind.case === 'clock' && this.world) this.follow(kind.value);
      else if (kind.case === 'editAnswer' && this.world) this.listener.onEditAnswer?.(kind.value);
      else if (kind.case === 'foundEdits' && this.world) this.listener.onFoundEdits?.(kind.value);
      else if (kind.case === 'squares' && this.world) this.listener.onSquares?.(kind.value);
      else if (kind.case === 'error') {
        this.why = text(kind.value.message);
        this.final = kind.value.code === Error_Code.VERSION;
      } else if (kind.case === 'iteration') throw new Refusal('an iteration before the world');
    } catch (error) {
      this.why = `The server sent something that cannot be understood: ${error instanceof Error ? error.message : error}.`;
      if (!(error instanceof Refusal)) console.warn(error);
      this.socket?.close();
      void this.lost(1002, '');
    }
  }

  private begin(world: World): void {
    if (this.world) throw new Refusal('a second world');
    if (world.protocolVersion !== PROTOCOL_VERSION || world.stepBits !== 8) {
      this.final = true;
      throw new Refusal(`it speaks protocol ${world.protocolVersion}, this page ${PROTOCOL_VERSION}; reload the page`);
    }
    clearTimeout(this.watchdog);
    this.world = world;
    this.sequence = this.step = 0n;
    const held = this.listener.onWorld(world);
    if (held.length <= MAX_RESUMED)
      for (let k = 0; k < held.length; k += RESUMED_AT_A_TIME) {
        const leaves = held.slice(k, k + RESUMED_AT_A_TIME).map((leaf) => ({ address: wireAddress(leaf.address), hash: leaf.hash }));
        this.send({ case: 'resume', value: create(ResumeSchema, { leaves }) });
      }
    if (this.camera && !this.options.lockstep) this.pose(this.camera);
  }

  private follow(clock: Clock): void {
    if (clock.step > this.step) this.send({ case: 'stepDone', value: create(StepDoneSchema, { step: clock.step }) });
    this.step = clock.step;
    this.listener.onClock?.(clock);
  }

  private forget(): void {
    if (this.socket) this.socket.onopen = this.socket.onmessage = this.socket.onclose = null;
    this.socket = undefined;
    this.world = undefined;
  }

  private async lost(code: number, reason: string): Promise<void> {
    const opened = this.world !== undefined;
    clearTimeout(this.watchdog);
    this.forget();
    if (this.over) return;
    let loss: Loss = { sentence: this.why || reason || (opened ? `The connection was lost (${code}).` : ''), final: this.final, wantsToken: false };
    if (!loss.sentence) {
      loss = (await this.options.explain?.()) ?? { sentence: 'The server cannot be reached.', final: false, wantsToken: false };
      if (this.over || this.socket) return;
    }
    this.over = loss.final;
    this.listener.onLost(loss);
    if (loss.final) return;
    this.timer = setTimeout(() => this.connect(), this.wait * (0.5 + 0.5 * Math.random()));
    this.wait = Math.min(LONGEST_WAIT, 2 * this.wait);
  }
}
