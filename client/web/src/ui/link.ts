// A link to a place: what the page shows, as the fragment of its address. Metres and degrees, as in path files. The form of the server's
// other clients, ?session=NAME&terrain=NAME&seed=N&clock=stepped, is read as well; where both name something, the fragment counts.

import type { Mode } from '../messages';
import { Pose, STEPS_PER_METRE } from '../render/view';
import { poseAt } from './flying';

export interface Place {
  pose: Pose; // y is NaN where it is not known yet: `altitude` above the ground there
  altitude: number;
  isAnywhere: boolean; // nobody asked for this place
  session: string;
  terrain: string; // of a session that is to be made where there is none; else empty
  seed: string;
  parameters: string[]; // of such a session's terrain, each NAME=NUMBER
  clock: string; // with which such a session begins, empty for the server's default
  threshold: number | undefined;
  mode: Mode;
  token: string;
  name: string; // one's own, for the others
}

const degrees = 180 / Math.PI;

export function readPlace({ hash, search }: Pick<Location, 'hash' | 'search'>): Place {
  const values = new URLSearchParams(hash.replace(/^#/, '')), asked = new URLSearchParams(search);
  for (const name of new Set(asked.keys())) if (!values.has(name)) for (const value of asked.getAll(name)) values.append(name, value);
  const number = (name: string, least: number, most: number): number | undefined => {
    const text = values.get(name);
    const value = text === null || text.trim() === '' ? NaN : Number(text);
    return Number.isFinite(value) ? Math.min(most, Math.max(least, value)) : undefined;
  };
  const x = number('x', -4e12, 4e12) ?? 0, z = number('z', -4e12, 4e12) ?? 0;
  const yaw = number('yaw', -3600, 3600) ?? 0, pitch = number('pitch', -88.8, 88.8) ?? -10;
  const mode = values.get('mode');
  return {
    pose: poseAt(x, number('y', -1e5, 3e4) ?? NaN, z, yaw / degrees, pitch / degrees),
    altitude: number('altitude', 2, 3e4) ?? 150,
    isAnywhere: !values.has('x') && !values.has('z'),
    session: values.get('session') || 'default',
    terrain: values.get('terrain') ?? '',
    seed: values.get('seed') ?? '',
    parameters: values.getAll('param').slice(0, 32),
    clock: values.get('clock') ?? '',
    threshold: number('threshold', 0.05, 1000),
    mode: mode === 'march' || mode === 'split' ? mode : 'mesh',
    token: values.get('token') ?? '',
    name: values.get('name') ?? '',
  };
}

/** A place that somebody types: x and z in metres, perhaps y, or a link. Nothing where it is neither. */
export function placeOf(text: string): Pick<Location, 'hash' | 'search'> | undefined {
  const numbers = text.trim().split(/[\s,;]+/).map(Number);
  if (numbers.length >= 2 && numbers.length <= 3 && numbers.every(Number.isFinite)) return { search: '', hash: `#x=${numbers[0]}&z=${numbers[1]}${numbers.length > 2 ? `&y=${numbers[2]}` : ''}` };
  return URL.canParse(text) && /[#?]./.test(text) ? new URL(text) : undefined;
}

/** Never with the token: links are for passing on. */
export function writePlace(place: Omit<Place, 'altitude' | 'token' | 'name'>): string {
  const { pose } = place;
  const parts: [string, string][] = [];
  const decimals = (v: number, n: number): string => String(Number(v.toFixed(n)));
  if (Number.isFinite(pose.y))
    parts.push(
      ['x', decimals((pose.x + pose.remainderX) / STEPS_PER_METRE, 4)],
      ['z', decimals((pose.z + pose.remainderZ) / STEPS_PER_METRE, 4)],
      ['y', decimals(pose.y, 3)],
      ['yaw', decimals(pose.yaw * degrees, 3)],
      ['pitch', decimals(pose.pitch * degrees, 3)],
    );
  if (place.session !== 'default') parts.push(['session', place.session]);
  if (place.terrain) parts.push(['terrain', place.terrain]);
  if (place.terrain && place.seed) parts.push(['seed', place.seed]);
  if (place.terrain) for (const parameter of place.parameters) parts.push(['param', parameter]);
  if (place.terrain && place.clock) parts.push(['clock', place.clock]);
  if (place.threshold !== undefined) parts.push(['threshold', String(place.threshold)]);
  if (place.mode !== 'mesh') parts.push(['mode', place.mode]);
  return '#' + parts.map(([name, value]) => `${name}=${encodeURIComponent(value)}`).join('&');
}
