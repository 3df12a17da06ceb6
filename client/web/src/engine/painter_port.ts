// The engine's end of its port to the painter: leaves as buffers, and what is to happen when the painter has taken them.

import { keyOf } from '../codec/mesh';
import type { FromPainterToEngine, LeafBuffers, ToPainterFromEngine } from '../messages';
import type { HeldLeaf } from '../scene/draft';
import type { Change } from '../scene/scene';

function buffersOf({ mesh, low, high }: HeldLeaf): LeafBuffers {
  const { address, vertices, triangles } = mesh;
  const corners = new Int32Array(3 * triangles.length);
  for (let k = 0, at = 0; k < triangles.length; ++k, at += 3) {
    const v = 3 * triangles[k]!;
    corners[at] = vertices[v]!;
    corners[at + 1] = vertices[v + 1]!;
    corners[at + 2] = vertices[v + 2]!;
  }
  return { key: keyOf(address), address, corners, low, high };
}

export class PainterPort {
  changes = 0; // that were shown
  private port: MessagePort | undefined;
  private readonly untaken: (() => void)[] = []; // as many as the server's window at most

  open(port: MessagePort): void {
    this.port = port;
    port.onmessage = (event: MessageEvent<FromPainterToEngine>) => {
      if (event.data.kind === 'taken') this.untaken.shift()?.();
    };
  }

  send(message: ToPainterFromEngine, transfer: Transferable[] = []): void {
    this.port?.postMessage(message, transfer);
  }

  show(change: Change, taken: () => void): void {
    const fresh = change.fresh.map(buffersOf);
    this.change({ kind: 'change', gone: change.gone.map(keyOf), fresh, clear: false }, taken);
  }
  clear(): void {
    this.change({ kind: 'change', gone: [], fresh: [], clear: true }, () => {});
  }

  private change(message: Extract<ToPainterFromEngine, { kind: 'change' }>, taken: () => void): void {
    this.untaken.push(taken);
    ++this.changes;
    this.send(
      message,
      message.fresh.map((leaf) => leaf.corners.buffer as ArrayBuffer),
    );
  }
}
