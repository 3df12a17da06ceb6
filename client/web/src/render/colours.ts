// The colour of a candidate by its error in pixels, as the desktop client has it (client/viewer/leaf_colours.cpp): it grows in brightness
// alone, and so can be told apart by everybody.

export type Colour = readonly [number, number, number];

// Inferno, by Nathaniel Smith and Stefan van der Walt, 2015, at six places.
const INFERNO: readonly Colour[] = [
  [0.988, 0.998, 0.645],
  [0.981, 0.644, 0.04],
  [0.865, 0.316, 0.226],
  [0.578, 0.148, 0.404],
  [0.258, 0.039, 0.406],
  [0.001, 0, 0.014],
];
export const ERROR_RANGE = 8;

/** Pale yellow at ERROR_RANGE times the threshold and more, orange at the threshold, violet below; even steps for each doubling. */
export function errorColour(pixels: number, threshold: number): Colour {
  const doublings = Math.log2(Math.max(pixels, 1e-9) / Math.max(threshold, 1e-9));
  const at = Math.min(1, Math.max(0, 0.32 - (0.32 * doublings) / Math.log2(ERROR_RANGE))) * (INFERNO.length - 1);
  const k = Math.min(Math.floor(at), INFERNO.length - 2), low = INFERNO[k]!, high = INFERNO[k + 1]!;
  return [0, 1, 2].map((c) => low[c]! + (at - k) * (high[c]! - low[c]!)) as unknown as Colour;
}
