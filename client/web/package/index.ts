export { type Change, Client, STEPS_PER_METRE, type View } from './client';
export { type Range, Triangles } from './triangles';
export type { ClockTold, DrawnLeaf, Drawing, Figures, FromEngine, MemberTold, WorldTold } from '../src/messages';
