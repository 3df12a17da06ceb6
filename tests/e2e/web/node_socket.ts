// A WebSocket for node, which has none before version 22: what RFC 6455 asks of a client that sends small binary messages.

import { randomBytes } from 'node:crypto';
import { Socket as Tcp, connect } from 'node:net';
import type { Socket } from '../../../client/web/src/engine/line';

export class NodeSocket implements Socket {
  binaryType = 'arraybuffer';
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  bytes = 0; // received
  private readonly tcp: Tcp;
  private upgraded = false;
  private pieces: Buffer[] = [];
  private waiting = 0;
  private message: Buffer[] = [];

  constructor(url: string) {
    const { hostname, port, pathname, search } = new URL(url);
    this.tcp = connect(Number(port), hostname, () => {
      this.tcp.write(
        `GET ${pathname}${search} HTTP/1.1\r\nHost: ${hostname}:${port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n` +
          `Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: ${randomBytes(16).toString('base64')}\r\n\r\n`,
      );
    });
    this.tcp.setNoDelay(true);
    this.tcp.on('data', (data) => {
      this.bytes += data.length;
      this.pieces.push(data);
      this.waiting += data.length;
      while (this.take());
    });
    this.tcp.on('error', () => {});
    this.tcp.on('close', () => this.end(1006, ''));
  }

  send(bytes: Uint8Array): void {
    this.frame(2, Buffer.from(bytes));
  }
  close(code = 1000): void {
    this.frame(8, Buffer.from([code >> 8, code & 255]));
    this.tcp.end();
  }

  private end(code: number, reason: string): void {
    this.onclose?.({ code, reason });
    this.onclose = null;
    this.tcp.destroy();
  }

  private frame(opcode: number, payload: Buffer): void {
    const mask = randomBytes(4);
    const masked = Buffer.from(payload);
    for (let k = 0; k < masked.length; ++k) masked[k]! ^= mask[k & 3]!;
    const n = payload.length, more = n < 126 ? 0 : n < 65536 ? 2 : 8;
    const head = Buffer.alloc(2 + more);
    head[0] = 0x80 | opcode;
    head[1] = 0x80 | (more === 0 ? n : more === 2 ? 126 : 127);
    if (more === 2) head.writeUInt16BE(n, 2);
    if (more === 8) head.writeBigUInt64BE(BigInt(n), 2);
    this.tcp.write(Buffer.concat([head, mask, masked]));
  }

  /** One frame, or the answer to the upgrade, where all of it is there. */
  private take(): boolean {
    if (this.waiting < 2) return false;
    const needs = (n: number): boolean => this.waiting >= n;
    const joined = (): Buffer => {
      if (this.pieces.length > 1) this.pieces = [Buffer.concat(this.pieces)];
      return this.pieces[0]!;
    };
    const consume = (n: number): void => {
      this.pieces = [joined().subarray(n)];
      this.waiting -= n;
    };
    if (!this.upgraded) {
      const end = joined().indexOf('\r\n\r\n');
      if (end < 0) return false;
      const status = joined().subarray(0, 12).toString();
      consume(end + 4);
      if (status !== 'HTTP/1.1 101') this.end(1006, status);
      else (this.upgraded = true), this.onopen?.();
      return true;
    }
    if (this.pieces[0]!.length < 10) joined();
    const first = this.pieces[0]!;
    let size = first[1]! & 127, at = 2;
    if (size === 126) (at = 4), needs(4) && (size = first.readUInt16BE(2));
    else if (size === 127) (at = 10), needs(10) && (size = Number(first.readBigUInt64BE(2)));
    if (!needs(at) || !needs(at + size)) return false;
    const payload = Buffer.from(joined().subarray(at, at + size)), opcode = first[0]! & 15, last = (first[0]! & 0x80) !== 0;
    consume(at + size);
    if (opcode === 8) this.end(payload.length >= 2 ? payload.readUInt16BE(0) : 1005, payload.subarray(2).toString());
    else if (opcode === 9) this.frame(10, payload);
    else if (opcode <= 2) {
      this.message.push(payload);
      if (last) {
        const whole = Buffer.concat(this.message);
        this.message = [];
        this.onmessage?.({ data: whole.buffer.slice(whole.byteOffset, whole.byteOffset + whole.length) });
      }
    }
    return true;
  }
}
