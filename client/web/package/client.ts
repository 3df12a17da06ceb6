// A client of a Ridgecast server: the mesh that fits a camera, who else is there, edits, the session's clock. What it does is done in a
// worker; it comes back by itself after a loss. Metres and radians: +y up, yaw 0 looks along -z and grows to the left, pitch upwards.

import type { Camera, Figures, FromEngine, FromPainterToEngine, MemberTold, ToEngine, ToPainterFromEngine, WorldTold } from '../src/messages';

export const STEPS_PER_METRE = 256; // of the lattice that all vertices lie on

/** What the mesh shall fit. */
export interface View {
  x: number;
  y: number;
  z: number;
  yaw: number;
  pitch: number;
  verticalFov: number;
  width: number; // pixels
  height: number;
}

/** What an iteration changed of the leaves: see Triangles. */
export type Change = Extract<ToPainterFromEngine, { kind: 'change' }>;

interface Edit {
  done: (number: number) => void;
  failed: (why: Error) => void;
}

export class Client {
  world: WorldTold | undefined; // the last that it was in
  figures: Figures | undefined; // of the last iteration
  others: MemberTold[] = []; // those near enough to be named
  countOfOthers = 0; // named or not
  ground: number | undefined; // metres, of the mesh below the newest camera
  lost = ''; // why there is no connection
  private readonly edits = new Map<number, Edit>();
  private readonly questions = new Map<number, (metres: Float64Array) => void>();
  private asked = 0;

  /** `on` hears everything, when it is kept. */
  constructor(
    private readonly on: (message: FromEngine) => void,
    private readonly worker: Worker,
  ) {
    worker.onmessage = ({ data }: MessageEvent<FromEngine>) => {
      this.keep(data);
      this.on(data);
    };
  }

  /** ws://HOST:PORT/v1/stream?session=NAME, and what else a new session is to be; again: elsewhere, or as somebody else. Threshold: pixels,
   *  0: the server's default. */
  connect(url: string, { token = '', name = '', threshold = 0 } = {}): void {
    this.send({ kind: 'start', url, token, name, threshold });
  }
  /** What comes goes to `draw`, before the next iteration but three is made. To be called once. */
  follow(draw: (change: Change) => void): void {
    const { port1, port2 } = new MessageChannel();
    this.followBy(port1);
    port2.onmessage = ({ data }: MessageEvent<ToPainterFromEngine>) => {
      if (data.kind === 'change') draw(data);
      if (data.kind === 'change' || data.kind === 'squares') port2.postMessage({ kind: 'taken' } satisfies FromPainterToEngine);
    };
  }
  /** Another thread has the port's other end, and says what it has taken. */
  followBy(port: MessagePort): void {
    this.send({ kind: 'painter', port }, [port]);
  }
  look({ x, y, z, ...view }: View): void {
    const camera: Camera = { ...view, x: Math.round(x * STEPS_PER_METRE), y, z: Math.round(z * STEPS_PER_METRE) };
    this.send({ kind: 'pose', camera, number: ++this.asked });
  }
  /** Of the mesh that is held, at x and z of each place; NaN where it has none. */
  heights(places: readonly number[]): Promise<Float64Array> {
    const number = ++this.asked, steps = Float64Array.from(places, (v) => Math.round(v * STEPS_PER_METRE));
    this.send({ kind: 'heights', number, places: steps }, [steps.buffer]);
    return new Promise((done) => this.questions.set(number, done));
  }
  /** Such as { op: 'crater', x, z, radius, depth }: server/README.md. The number of the edit. It is made at most once: after a loss it is
   *  sent again with its key; if three connections end before the answer, it fails with a sentence that says so. */
  edit(operation: object): Promise<number> {
    const id = ++this.asked;
    this.send({ kind: 'edit', id, operation: JSON.stringify(operation) });
    return new Promise((done, failed) => this.edits.set(id, { done, failed }));
  }
  /** Session seconds a second, 0: it stands; and to which second it jumps. */
  setClock(rate: number, second?: number): void {
    this.send({ kind: 'set clock', rate, time: second === undefined ? 0 : Math.max(1, Math.round(1e6 * second)) });
  }
  /** Tries to come back at once. */
  hurry(): void {
    this.send({ kind: 'hurry' });
  }
  close(): void {
    this.send({ kind: 'stop' });
  }

  send(message: ToEngine, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  protected keep(message: FromEngine): void {
    switch (message.kind) {
      case 'world':
        this.world = message.world;
        this.lost = '';
        return;
      case 'lost':
        this.lost = message.sentence;
        return;
      case 'figures':
        this.figures = message.figures;
        return;
      case 'granted':
        if (this.world) this.world.threshold = message.threshold;
        return;
      case 'ground':
        this.ground = message.metres;
        return;
      case 'members':
        this.others = message.members;
        this.countOfOthers = message.others;
        return;
      case 'heights':
        this.questions.get(message.number)?.(message.metres);
        this.questions.delete(message.number);
        return;
      case 'edit answer': {
        const edit = this.edits.get(message.id);
        this.edits.delete(message.id);
        return message.number > 0 ? edit?.done(message.number) : edit?.failed(new Error(message.refusal));
      }
    }
  }
}
