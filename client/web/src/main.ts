// The page: begins the viewer, and tells tests of it.

import './style.css';
import { Viewer } from './ui/viewer';

const viewer = new Viewer();
const { engine, painter, flying } = viewer;

const report = () => ({
  connected: engine.lost === '' && engine.world !== undefined,
  lost: engine.lost,
  world: engine.world,
  figures: engine.figures,
  frames: painter.frames,
  atRest: viewer.atRest,
  drawn: viewer.drawn,
  others: engine.others,
  pose: flying.pose,
  clock: viewer.clock.time,
});
/** What tests read. */
export type Report = ReturnType<typeof report>;
Object.defineProperty(globalThis, 'ridgecast', { get: report });
viewer.begin();
