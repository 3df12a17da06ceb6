// The engine's end of its port to the painter: leaves as buffers, and what is to happen when the painter has taken them.

import { keyOf } from '../codec/mesh';
import type { EditSquare, FromPainterToEngine, ToPainterFromEngine } from '../messages';
import type { Change } from '../scene/scene';

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
    const { gone, drawn, drawing } = change, fresh = drawn.map(({ address, low, high }) => ({ key: keyOf(address), address, low, high }));
    this.change({ kind: 'change', gone: gone.map(keyOf), fresh, drawing, clear: false }, Object.values(drawing), taken);
  }
  showSquares(gone: string[], fresh: EditSquare[]): void {
    this.change({ kind: 'squares', gone, fresh }, fresh.map((square) => square.posts));
  }
  clear(): void {
    this.change({ kind: 'change', gone: [], fresh: [], clear: true }, []);
  }

  private change(message: ToPainterFromEngine, arrays: readonly (Int32Array | Uint32Array)[], taken: () => void = () => {}): void {
    this.untaken.push(taken);
    ++this.changes;
    this.send(
      message,
      arrays.map((array) => array.buffer as ArrayBuffer),
    );
  }
}
