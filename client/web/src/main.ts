// The page: wires the viewer, and tells tests of it.

import './style.css';
import type { Figures, MemberTold, WorldTold } from './messages';
import type { Pose } from './render/view';
import type { Frames } from './ui/painter_link';
import { Viewer } from './ui/viewer';

const viewer = new Viewer();
const { engine, painter, flying } = viewer;

/** What tests read. */
export interface Report {
  connected: boolean;
  lost: string;
  world: WorldTold | undefined;
  figures: Figures | undefined;
  frames: Frames | undefined;
  atRest: boolean;
  drawn: boolean;
  others: MemberTold[];
  pose: Pose;
}
Object.defineProperty(globalThis, 'ridgecast', {
  get: (): Report => ({
    connected: engine.lost === '' && engine.world !== undefined,
    lost: engine.lost,
    world: engine.world,
    figures: engine.figures,
    frames: painter.frames,
    atRest: viewer.atRest,
    drawn: viewer.drawn,
    others: engine.others,
    pose: flying.pose,
  }),
});
viewer.begin();
