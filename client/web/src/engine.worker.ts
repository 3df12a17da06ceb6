// The engine's thread: see engine/engine.ts.

import dracoFactory from 'draco3d/draco_decoder_nodejs.js';
import dracoUrl from 'draco3d/draco_decoder.wasm?url';
import { DracoFactory, loadDraco } from './core/draco';
import { Engine, Parts } from './engine/engine';
import coreUrl from './generated/core.wasm?url';
import type { FromEngine, ToEngine } from './messages';

const page = self as unknown as { postMessage(message: FromEngine): void; onmessage: ((event: MessageEvent<ToEngine>) => void) | null };

async function loadBytes(url: string): Promise<ArrayBuffer> {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`the decoder cannot be loaded (${answer.status})`);
  return answer.arrayBuffer();
}

async function loadParts(): Promise<Parts> {
  const [draco, core] = await Promise.all([dracoUrl, coreUrl].map(loadBytes));
  return { draco: await loadDraco(dracoFactory as unknown as DracoFactory, draco!), core: await WebAssembly.compile(core!) };
}

const engine = new Engine((message) => page.postMessage(message), loadParts);
page.onmessage = ({ data }) => engine.hear(data);
self.addEventListener('error', (event) => {
  if (!(event.error instanceof WebAssembly.RuntimeError)) return; // the page says so
  event.preventDefault();
  engine.failed();
});
