// The core's lines to a server, one after another: WebSockets and timers. Which frames travel, and when another line is opened, the core
// knows.

import type { Core } from '../core/core';
import type { Loss } from '../messages';

const TIMEOUT = 15_000; // ms from an attempt to the world, unless told otherwise
const SILENCE = 4_000; // ms; a server that is there says each second what time it is, as the core asks
const MAX_MESSAGE = 256 * 2 ** 20;

/** What a line needs of a WebSocket. */
export interface Socket {
  binaryType: string;
  onopen: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  onclose: ((event: { code: number; reason: string }) => void) | null;
  send(bytes: Uint8Array): void;
  close(code?: number): void;
}

export interface Options {
  /** `elsewhere`: the origin of another server than the one named at first (ws://HOST:PORT); empty: that one. */
  open: (elsewhere: string, showsToken: boolean) => Socket;
  onLost: (loss: Loss) => void;
  /** Nothing has come for a while, or something again. */
  onSilence?: (isSilent: boolean) => void;
  /** More where the server may have to compile the world first. */
  timeout?: number;
  /** Why a socket could not even be opened, where that can be found out; sockets do not say. */
  explain?: () => Promise<Loss | undefined>;
}

const asSentence = (why: string): string => why.charAt(0).toUpperCase() + why.slice(1) + (/[.!?]$/.test(why) ? '' : '.');

export class Line {
  heardAt = 0; // when the last frame came: performance.now()
  private socket: Socket | undefined;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private watchdog: ReturnType<typeof setTimeout> | undefined;
  private elsewhere = '';
  private over = false;
  private isSilent = false;

  constructor(
    private readonly core: Core,
    private readonly options: Options,
  ) {}

  /** To be called when the core may have something to send. */
  go(): void {
    clearTimeout(this.timer);
    const wait = this.over ? -1 : this.core.step();
    if (wait >= 0) this.timer = setTimeout(() => this.go(), wait);
  }
  /** For good. */
  close(): void {
    const { socket } = this;
    this.over = true;
    clearTimeout(this.timer);
    this.forget();
    socket?.close(1000);
  }

  // ---- what the core asks for ----

  dial(elsewhere: string, showsToken: boolean): void {
    this.elsewhere = elsewhere;
    let socket: Socket;
    try {
      socket = this.options.open(elsewhere, showsToken);
    } catch (error) {
      if (elsewhere) return queueMicrotask(() => void this.lost(String(error))); // back to the first one
      this.close();
      return this.options.onLost({ sentence: asSentence(String(error)), final: true, wantsToken: false });
    }
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.core.opened();
      this.go();
    };
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = ({ code, reason }) => void this.lost(reason || (this.core.isGreeted ? `The connection was lost (${code})` : ''));
    this.watchdog = setTimeout(() => this.hangUp('The server did not answer in time'), this.options.timeout ?? TIMEOUT);
  }
  send(frame: Uint8Array): void {
    this.socket?.send(frame);
  }
  hangUp(why: string): void {
    const { socket } = this;
    this.forget();
    socket?.close();
    if (socket) queueMicrotask(() => void this.lost(why));
  }

  private receive(data: unknown): void {
    if (!(data instanceof ArrayBuffer) || data.byteLength > MAX_MESSAGE) return this.hangUp('The server sent a message that is not binary, or too large');
    this.heardAt = performance.now();
    this.core.heard(new Uint8Array(data));
    if (this.socket && this.core.isGreeted) this.listen();
    this.go();
  }

  private listen(): void {
    clearTimeout(this.watchdog);
    this.watchdog = setTimeout(() => this.options.onSilence?.((this.isSilent = true)), SILENCE);
    if (this.isSilent) this.options.onSilence?.((this.isSilent = false));
  }

  private forget(): void {
    clearTimeout(this.watchdog);
    this.isSilent = false;
    if (this.socket) this.socket.onopen = this.socket.onmessage = this.socket.onclose = null;
    this.socket = undefined;
  }

  private async lost(why: string): Promise<void> {
    this.forget();
    const loss = why ? { sentence: asSentence(why), final: false, wantsToken: false } : ((await (this.elsewhere ? undefined : this.options.explain?.())) ?? { sentence: 'The server cannot be reached.', final: false, wantsToken: false });
    if (this.over) return;
    this.core.closed(loss.sentence);
    const final = loss.final || !this.core.comesBack;
    if (final) this.close();
    this.options.onLost({ ...loss, final });
    this.go();
  }
}
