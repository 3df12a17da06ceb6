// A server that says to a page what a real one once said to a client of the same poses, as fast as the page acknowledges it: what the
// page can take, without the work of making it.

import { fromBinary, toBinary, create } from '@bufbuild/protobuf';
import { createHash } from 'node:crypto';
import { existsSync, readFileSync } from 'node:fs';
import { Server as HttpServer, createServer } from 'node:http';
import type { AddressInfo } from 'node:net';
import { extname, join } from 'node:path';
import type { Duplex } from 'node:stream';
import { ClientMessageSchema, Pacing, PoseSchema, ServerMessageSchema } from '../../../client/web/src/generated/ridgecast/v1/stream_pb';
import type { Camera } from '../../../client/web/src/messages';
import { NodeSocket } from './node_socket';

const WINDOW = 4; // iterations that may be unacknowledged
const TYPES: Record<string, string> = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.wasm': 'application/wasm' };

/** The messages of a stream in lock-step: the world, then an iteration for each camera. */
export async function record(url: string, cameras: Camera[], threshold: number): Promise<Uint8Array[]> {
  const messages: Uint8Array[] = [];
  const socket = new NodeSocket(`${url}/v1/stream`);
  const send = (kind: NonNullable<Parameters<typeof create<typeof ClientMessageSchema>>[1]>['kind']): void => socket.send(toBinary(ClientMessageSchema, create(ClientMessageSchema, { kind })));
  return new Promise((resolve, reject) => {
    socket.onopen = () => send({ case: 'hello', value: { $typeName: 'ridgecast.v1.Hello', protocolVersion: 1, clientName: new Uint8Array(), pacing: Pacing.LOCKSTEP, points: true, role: 0, members: false, clock: false, errors: false, edits: false, editsAfter: 0n, near: 0, states: false, placesOnly: false, settings: { $typeName: 'ridgecast.v1.Settings', metric: 0, threshold, triangleBudget: 0, bytesPerSecond: 0n, candidates: 0, colourError: 0 } } });
    socket.onclose = ({ reason }) => reject(new Error(`the recording ended: ${reason}`));
    socket.onmessage = ({ data }) => {
      const bytes = new Uint8Array(data as ArrayBuffer), { kind } = fromBinary(ServerMessageSchema, bytes);
      messages.push(bytes);
      if (kind.case === 'iteration') send({ case: 'acknowledge', value: { $typeName: 'ridgecast.v1.Acknowledge', iteration: kind.value.number, meshHash: kind.value.meshHash } });
      const camera = cameras[messages.length - 1];
      if (camera) return send({ case: 'pose', value: create(PoseSchema, { ...camera, sequence: BigInt(messages.length), x: BigInt(camera.x), z: BigInt(camera.z) }) });
      socket.onclose = null;
      socket.close();
      resolve(messages);
    };
  });
}

function frameOf(payload: Uint8Array): Buffer {
  const head = Buffer.alloc(10);
  head[0] = 0x82;
  head[1] = 127;
  head.writeBigUInt64BE(BigInt(payload.length), 2);
  if (payload.length >= 65536) return Buffer.concat([head, payload]);
  const short = payload.length < 126 ? Buffer.from([0x82, payload.length]) : Buffer.from([0x82, 126, payload.length >> 8, payload.length & 255]);
  return Buffer.concat([short, payload]);
}

/** Serves the page from `folder`, and the recording to whoever opens a stream. */
export class Replay {
  private readonly http: HttpServer;

  constructor(
    folder: string,
    private readonly messages: readonly Uint8Array[],
  ) {
    this.http = createServer((request, response) => {
      const path = new URL(request.url!, 'http://x').pathname, file = join(folder, path === '/' ? 'index.html' : path);
      if (!existsSync(file)) response.writeHead(404).end();
      else response.writeHead(200, { 'Content-Type': TYPES[extname(file)] ?? 'text/plain' }).end(readFileSync(file));
    });
    this.http.on('upgrade', (request, socket) => {
      const accept = createHash('sha1').update(request.headers['sec-websocket-key'] + '258EAFA5-E914-47DA-95CA-C5AB0DC85B11').digest('base64');
      socket.write(`HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: ${accept}\r\n\r\n`);
      this.play(socket);
    });
  }

  async listen(): Promise<string> {
    await new Promise<void>((done) => this.http.listen(0, '127.0.0.1', done));
    return `http://127.0.0.1:${(this.http.address() as AddressInfo).port}`;
  }
  close(): void {
    this.http.closeAllConnections();
    this.http.close();
  }

  private play(socket: Duplex): void {
    let waiting = Buffer.alloc(0), sent = 0, acknowledged = 0;
    const go = (): void => {
      while (sent + 1 < this.messages.length && sent - acknowledged < WINDOW) socket.write(frameOf(this.messages[++sent]!));
    };
    socket.on('error', () => {});
    socket.on('data', (data: Buffer) => {
      waiting = Buffer.concat([waiting, data]);
      for (;;) {
        if (waiting.length < 6) return;
        let size = waiting[1]! & 127, at = 2;
        if (size === 126) (size = waiting.readUInt16BE(2)), (at = 4);
        if (waiting.length < at + 4 + size) return;
        const mask = waiting.subarray(at, at + 4), payload = Buffer.from(waiting.subarray(at + 4, at + 4 + size));
        for (let k = 0; k < size; ++k) payload[k]! ^= mask[k & 3]!;
        const opcode = waiting[0]! & 15;
        waiting = waiting.subarray(at + 4 + size);
        if (opcode === 8) return void socket.end();
        if (opcode !== 2) continue;
        const { kind } = fromBinary(ClientMessageSchema, payload);
        if (kind.case === 'hello') socket.write(frameOf(this.messages[0]!));
        if (kind.case === 'acknowledge') acknowledged = Number(kind.value.iteration);
        if (kind.case === 'acknowledge' || kind.case === 'pose') go();
      }
    });
  }
}
