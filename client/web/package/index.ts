import type { FromEngine } from '../src/messages';
import { Client as OfWorker } from './client';

/** With the package's own worker. */
export class Client extends OfWorker {
  constructor(on: (message: FromEngine) => void = () => {}, worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module' })) {
    super(on, worker);
  }
}
export { type Change, STEPS_PER_METRE, type View } from './client';
export { type Range, Triangles } from './triangles';
export type { ClockTold, DrawnLeaf, Drawing, Figures, FromEngine, MemberTold, WorldTold } from '../src/messages';
