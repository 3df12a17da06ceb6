// The engine's thread: see engine/engine.ts.

import dracoFactory from 'draco3d/draco_decoder_nodejs.js';
import dracoUrl from 'draco3d/draco_decoder.wasm?url';
import { DracoFactory, loadDraco } from './codec/draco';
import type { DracoDecode } from './codec/leaf';
import { Engine } from './engine/engine';
import type { FromEngine, ToEngine } from './messages';

const page = self as unknown as { postMessage(message: FromEngine): void; onmessage: ((event: MessageEvent<ToEngine>) => void) | null };

async function loadDecoder(): Promise<DracoDecode> {
  const wasm = await fetch(dracoUrl);
  if (!wasm.ok) throw new Error(`the decoder cannot be loaded (${wasm.status})`);
  return loadDraco(dracoFactory as unknown as DracoFactory, await wasm.arrayBuffer());
}

const engine = new Engine((message) => page.postMessage(message), loadDecoder);
page.onmessage = ({ data }) => engine.hear(data);
