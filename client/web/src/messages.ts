// What the page's three threads say to each other. The page itself reads keys and shows figures; the engine (engine.worker.ts) holds the
// connection and the mesh; the painter (painter.worker.ts) holds the pictures. Only plain values and transferred buffers travel.

import type { Pose, Vec3 } from './render/view';

/** A camera in protocol units: steps, metres, radians, pixels. */
export interface Camera {
  x: number; // whole steps
  z: number;
  y: number;
  yaw: number;
  pitch: number;
  verticalFov: number;
  width: number;
  height: number;
}

export interface LeafAddress {
  readonly level: number;
  readonly i: number; // whole, |i| <= 2^37
  readonly j: number;
}

/** Why there is no connection. */
export interface Loss {
  sentence: string; // for a person
  final: boolean; // else it will be tried again
  wantsToken: boolean;
}

// ---- the page to the engine ----

export type ToEngine =
  | { kind: 'painter'; port: MessagePort }
  | { kind: 'start'; url: string; threshold: number; token: string; name: string } // begins, or begins anew; what is held is resumed
  | { kind: 'pose'; camera: Camera; number: number } // the page counts them, from 1
  | { kind: 'candidates'; wanted: boolean } // for vertices
  | { kind: 'threshold'; pixels: number }
  | { kind: 'edit'; id: number; operation: string } // sent once there is a connection
  | { kind: 'brush'; brush: Brush }
  | { kind: 'act'; act: Act; by: number }
  | { kind: 'heights'; number: number; places: Float64Array<ArrayBuffer> } // x and z of each, steps
  | { kind: 'set clock'; rate: number; time: number } // session seconds a second, 0: it stands; microseconds, 0: no jump
  | { kind: 'drive'; drive: Drive; to: number } // microseconds, for 'to'
  | { kind: 'hurry' } // try to connect now
  | { kind: 'stop' };

/** What lies under the brush? */
export interface Brush {
  from: Pose;
  towards: Vec3; // through the pointer; any length
  uses: boolean; // it, there
}

/** What a person does to the ground and to the session's clock: client/core/hands. `by`: a tool's number, a material's, notches. */
export const ACTS = ['choose', 'paint', 'widen', 'rest', 'undo', 'end road'] as const, DRIVES = ['toggle', 'slower', 'faster', 'back', 'ahead', 'to'] as const;
export const TOOLS = ['crater', 'raise', 'lower', 'level', 'smooth', 'road'] as const;
export type Act = (typeof ACTS)[number];
export type Drive = (typeof DRIVES)[number];

/** A place on the ground. */
export interface Place {
  x: number; // steps
  z: number;
  y: number; // metres
}

/** The ground under a brush, of the mesh that is held; nothing where the ray meets none. */
export interface Touched {
  outline: Place[]; // a circle
  line: Place[]; // of a road that is being drawn, to the brush
}

export interface EditingTold {
  tool: number; // of TOOLS
  words: string; // what the brush does where it is used
  mayUndo: boolean;
}

export interface WorldTold {
  terrain: string;
  seed: number;
  session: string;
  camera: string; // its number, decimal
  lacks: string; // why the page has no functions of the terrain; empty: it has them
  threshold: number; // granted
  takesEdits: boolean;
  map?: { x0: number; z0: number; x1: number; z1: number }; // steps: where a height map lies
}

/** The session's clock. */
export interface ClockTold {
  time: number; // microseconds, `at` then
  at: number; // milliseconds since 1970
  runs: boolean;
  rate: number; // session seconds a second, that it runs at, or goes on with
  end: number; // microseconds, of a recording; 0: it is none
  driver: string; // who else has it; empty: nobody
  jumps: boolean; // it may be set to a time
}

/** Somebody else in the session. */
export interface MemberTold {
  camera: string;
  name: string;
  at?: { x: number; y: number; z: number }; // steps, metres, steps; nothing: it has sent no pose
}

export interface Figures {
  iteration: number;
  triangles: number;
  leaves: number;
  settled: boolean; // for the newest pose that the engine has, with all edits around it
  edit: number; // the last that the mesh knows; 0: none
  pose: number; // that one's
  changes: number; // that the painter was given, since the page began
  hashOk: boolean;
  effectiveThreshold: number;
  bytes: number; // of iterations, since the page began
  decoded: number; // triangles that came, since the page began
  candidates: number; // for vertices, where they are wanted
  decodeMs: number; // of this iteration, until the painter is given what changed
  hashes: number; // iterations whose hash was compared, since the page began
  mismatches: number;
  latencyMs: number; // from a pose to its iteration; 0: unknown
}

export type FromEngine =
  | { kind: 'world'; world: WorldTold }
  | { kind: 'granted'; threshold: number }
  | { kind: 'clock'; clock: ClockTold }
  | { kind: 'notice'; sentence: string } // of what was done to the ground or the clock
  | { kind: 'editing'; editing: EditingTold }
  | { kind: 'members'; members: MemberTold[]; others: number } // those near enough to be named; how many others there are in all
  | { kind: 'edit answer'; id: number; number: number; refusal: string } // number 0: refused
  | { kind: 'touched'; touched?: Touched } // the answer to a brush
  | { kind: 'heights'; number: number; metres: Float64Array<ArrayBuffer> } // of the mesh; NaN where it has none
  | ({ kind: 'lost' } & Loss)
  | { kind: 'silence'; isSilent: boolean } // of the server, for some seconds
  | { kind: 'figures'; figures: Figures }
  | { kind: 'ground'; metres: number }; // of the mesh below the newest pose

// ---- the engine to the painter, over a port of their own ----

/** Of leaves, for a copy of the slots that their triangles lie in, BLOCK to a block (core::PointMesh::Drawing). */
export interface Drawing {
  readonly ends: Uint32Array; // of each leaf, where its blocks end in `blocks`
  readonly blocks: Uint32Array; // the numbers of all its blocks now
  readonly changed: Uint32Array; // slots in these that are not as they were told last, block by block
  readonly corners: Int32Array; // of those, x, z, y of three corners, steps from their leaf's corner; 0 where there is no triangle
}
export const BLOCK = 16, SLOT = 9; // slots of a block, numbers of a slot

export interface DrawnLeaf {
  key: string;
  address: LeafAddress;
  low: readonly [number, number, number];
  high: readonly [number, number, number];
}

/** Places that may become vertices, the worst first. */
export interface Candidates {
  x: number; // steps: what the points are counted from
  z: number;
  points: Int32Array; // x, z, y of each, steps
  errors: Float32Array; // pixels
  threshold: number; // pixels: the error that one becomes a vertex for
}

/** Posts that edits have raised: 128 x 128, each 16 x its rise + its material (common/terrain/edited.glsl). */
export interface EditSquare {
  key: string;
  i: number; // sides
  j: number;
  posts: Int32Array;
  lowest: number; // of the rises, and 0: steps
  highest: number;
}

export type ToPainterFromEngine =
  | { kind: 'world'; source: string; seed: number; horizon: number }
  | { kind: 'change'; gone: string[]; fresh: DrawnLeaf[]; drawing: Drawing; clear: boolean } // the drawing of the fresh ones
  | { kind: 'squares'; gone: string[]; fresh: EditSquare[] } // taken as changes are
  | { kind: 'candidates'; candidates?: Candidates };

/** The painter has taken a change: the engine acknowledges only then, so that changes never pile up here. */
export type FromPainterToEngine = { kind: 'taken' };

// ---- the page to the painter ----

export type Mode = 'mesh' | 'march' | 'split';

export interface Look {
  mode: Mode;
  divider: number; // share of the width where the mesh ends in 'split'
  wireframe: boolean;
  nodes: boolean;
  candidates: boolean;
  corrected: boolean; // the mesh onto the true surface, where its function is known and a picture stays within its time
}

export type ToPainter =
  | { kind: 'begin'; canvas: OffscreenCanvas; engine: MessagePort }
  | { kind: 'size'; width: number; height: number } // pixels of the canvas
  | { kind: 'pose'; pose: Pose; verticalFov: number; rests: boolean } // rests: nobody moves it now
  | { kind: 'look'; look: Look }
  | { kind: 'picture' }; // asks for a PNG of what is shown

export type FromPainter =
  | { kind: 'problem'; sentence: string; fatal: boolean } // fatal: no picture will be drawn any more
  // `messages` of the page and `changes` of the engine were heard before.
  | { kind: 'frames'; perSecond: number; coarseness: number; corrected: boolean; milliseconds: number; finest: boolean; messages: number; changes: number }
  | { kind: 'picture'; png: Blob };
