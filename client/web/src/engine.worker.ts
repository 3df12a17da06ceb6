// The engine's thread: see engine/engine.ts.

import dracoFactory from 'draco3d/draco_decoder_nodejs.js';
import dracoUrl from 'draco3d/draco_decoder.wasm?url';
import { DracoFactory, loadDraco } from './codec/draco';
import { Engine, Parts } from './engine/engine';
import pointsUrl from './generated/point_mesh.wasm?url';
import type { FromEngine, ToEngine } from './messages';

const page = self as unknown as { postMessage(message: FromEngine): void; onmessage: ((event: MessageEvent<ToEngine>) => void) | null };

async function loadBytes(url: string): Promise<ArrayBuffer> {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`the decoder cannot be loaded (${answer.status})`);
  return answer.arrayBuffer();
}

async function loadParts(): Promise<Parts> {
  const [draco, points] = await Promise.all([dracoUrl, pointsUrl].map(loadBytes));
  return { draco: await loadDraco(dracoFactory as unknown as DracoFactory, draco!), points: await WebAssembly.compile(points!) };
}

const engine = new Engine((message) => page.postMessage(message), loadParts);
page.onmessage = ({ data }) => engine.hear(data);
