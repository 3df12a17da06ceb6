// Colours that mean something: of a candidate's error and of a leaf's level, as the desktop client has them (client/viewer/leaf_colours.cpp),
// both growing in brightness alone, so that everybody can tell them apart; and of members.

export type Colour = readonly [number, number, number];

// Both by Nathaniel Smith and Stefan van der Walt, 2015, at six places.
const INFERNO: readonly Colour[] = [
  [0.988, 0.998, 0.645],
  [0.981, 0.644, 0.04],
  [0.865, 0.316, 0.226],
  [0.578, 0.148, 0.404],
  [0.258, 0.039, 0.406],
  [0.001, 0, 0.014],
];
const VIRIDIS: readonly Colour[] = [
  [0.993, 0.906, 0.144],
  [0.478, 0.821, 0.318],
  [0.133, 0.659, 0.518],
  [0.164, 0.471, 0.558],
  [0.254, 0.265, 0.53],
  [0.267, 0.005, 0.329],
];
export const ERROR_RANGE = 8, COARSEST_LEVEL = 10;

// After Masataka Okabe and Kei Ito, 2008, light enough for a dark label.
const MEMBERS = ['#e69f00', '#56b4e9', '#2fc29a', '#f0e442', '#7fb2ff', '#ff8a4c', '#e59ac4', '#ffffff'];

function along(ramp: readonly Colour[], share: number): Colour {
  const at = Math.min(1, Math.max(0, share)) * (ramp.length - 1);
  const k = Math.min(Math.floor(at), ramp.length - 2), low = ramp[k]!, high = ramp[k + 1]!;
  return [0, 1, 2].map((c) => low[c]! + (at - k) * (high[c]! - low[c]!)) as unknown as Colour;
}

/** Pale yellow at ERROR_RANGE times the threshold and more, orange at the threshold, violet below; even steps for each doubling. */
export function errorColour(pixels: number, threshold: number): Colour {
  const doublings = Math.log2(Math.max(pixels, 1e-9) / Math.max(threshold, 1e-9));
  return along(INFERNO, 0.32 - (0.32 * doublings) / Math.log2(ERROR_RANGE));
}
export const levelColour = (level: number): Colour => along(VIRIDIS, level / COARSEST_LEVEL);
/** As CSS has it, of a camera's number, decimal. */
export const memberColour = (camera: string): string => MEMBERS[Number(BigInt(camera) % BigInt(MEMBERS.length))]!;

export const css = (colour: Colour): string => `rgb(${colour.map((c) => Math.round(255 * c)).join(' ')})`;
/** The ramp of levels for a shader. */
export const LEVELS_IN_GLSL = `vec3[${VIRIDIS.length}](${VIRIDIS.map((c) => `vec3(${c.map((v) => v.toFixed(3)).join(', ')})`).join(', ')})`;
