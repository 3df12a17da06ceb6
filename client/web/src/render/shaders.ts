// The shaders: what they share with the desktop client (common/terrain, common/shaders) and what the page alone draws, as GLSL ES 3.00
// around the terrain's own functions, which arrive with the world.

import { COARSEST_LEVEL, LEVELS_IN_GLSL } from './colours';
import edited from '../../../../common/terrain/edited.glsl?raw';
import editedBefore from '../../../../common/terrain/edited_before.glsl?raw';
import materialColor from '../../../../common/terrain/material_color.glsl?raw';
import prelude from '../../../../common/terrain/prelude.glsl?raw';
import rasterCubic from '../../../../common/terrain/raster_cubic.glsl?raw';
import shading from '../../../../common/terrain/shading.glsl?raw';
import correct from '../../../../common/shaders/correct.glsl?raw';
import dots from '../../../../common/shaders/dots.glsl?raw';
import dotsVertex from '../../../../common/shaders/dots_vertex.glsl?raw';
import fullScreen from '../../../../common/shaders/full_screen.glsl?raw';
import march from '../../../../common/shaders/march.glsl?raw';
import meshVertex from '../../../../common/shaders/mesh_vertex.glsl?raw';
import neutralTerrain from '../../../../common/shaders/neutral_terrain.glsl?raw';
import shade from '../../../../common/shaders/shade.glsl?raw';
import view from '../../../../common/shaders/view.glsl?raw';

const HEAD = 'precision highp float;\nprecision highp int;\nprecision highp sampler2D;\n';

export const FULL_SCREEN = HEAD + fullScreen;
export const DOT_VERTEX = HEAD + dotsVertex;
export const DOT_FRAGMENT = HEAD + dots;
export const MESH_VERTEX = `${HEAD}#define BLOCKS\n${meshVertex}`;

// The depth is logarithmic: it spreads 0.1 m to 200 km evenly.
// w is 1 + the leaf's level + half of how much of this sample is an edge of a triangle; where triangles are small on the screen, edges fade.
export const MESH_FRAGMENT = `${HEAD}
uniform float edges;
flat in float leafLevel;
in vec3 offset;
in vec3 corner;
in float depth;
layout(location = 0) out vec4 surface;
void main() {
  vec3 wide = fwidth(corner);
  vec3 near = 1.0 - smoothstep(0.4 * wide, 1.1 * wide, corner);
  float edge = max(near.x, max(near.y, near.z)) * (1.0 - smoothstep(0.04, 0.3, max(wide.x, max(wide.y, wide.z))));
  surface = vec4(offset, 1.0 + leafLevel + 0.498 * edge * edges);
  gl_FragDepth = clamp(log2(max(depth, 0.1) * 10.0) / log2(2000000.0), 0.0, 1.0);
}
`;

// What is drawn over the ground's display values: triangles' edges, and the squares of the leaves, tinted by level as in the desktop client
// (viridis, by Nathaniel Smith and Stefan van der Walt: it grows in brightness alone).
const OVERLAY = `
#define OVERLAID
uniform float showNodes;
vec3 levelColour(float level) {
  vec3 ramp[6] = ${LEVELS_IN_GLSL};
  float at = clamp(level / ${COARSEST_LEVEL}.0, 0.0, 1.0) * 5.0;
  int k = min(int(at), 4);
  return mix(ramp[k], ramp[k + 1], at - float(k));
}
vec3 overlaid(vec3 shown, vec4 s, float range) {
  float level = floor(s.w) - 1.0;
  if (showNodes > 0.0) {
    ivec2 steps = viewSteps + ivec2(floor(s.xz * 256.0 + viewRemainder));
    ivec2 cell = viewCell + (steps >> 20);
    int side = 1 << (13 + int(level));
    ivec2 inside = (((cell & 7) << 20) | (steps & 0xfffff)) & (side - 1);
    ivec2 border = min(inside, side - inside);
    float metres = float(min(border.x, border.y)) / 256.0;
    float wide = viewFootprint(dot(s.xyz, viewForward)) / clamp(-s.y / max(range, 1e-3), 0.4, 1.0);
    shown = mix(shown, levelColour(level), mix(0.3, 0.95, 1.0 - smoothstep(0.5 * wide, 1.2 * wide, metres)));
  }
  float edge = min(1.0, fract(s.w) * 2.0) * mix(0.6, 0.12, smoothstep(0.0, 0.3, range / viewHorizon));
  return mix(shown, vec3(0.02, 0.03, 0.05), edge);
}
`;

// The terrain's height on a grid around the camera.
const HEIGHTS = `
uniform float heightsSpacing;  // metres
uniform float heightsSide;     // samples
layout(location = 0) out vec4 height;
void main() {
  ivec2 cell;
  vec2 fraction;
  viewLocate((gl_FragCoord.xy - 0.5 * heightsSide) * heightsSpacing, cell, fraction);
  height = vec4(terrainHeight(cell, fraction, 0.0, viewSeed), 0.0, 0.0, 1.0);
}
`;

/** A finished picture into the window, stretched. */
export const PRESENT = `${HEAD}
uniform sampler2D picture;
uniform vec2 windowSize;
layout(location = 0) out vec4 colour;
void main() { colour = vec4(texture(picture, gl_FragCoord.xy / windowSize).rgb, 1.0); }
`;

/** The programs that hold the terrain's functions; an empty source is a world whose text is private. */
export function terrainShaders(source: string): { skyline: string; march: string; correct: string; shade: string; heights: string } {
  const terrain = source ? `${editedBefore}\n${source}\n${edited}\n${rasterCubic}\n${materialColor}` : neutralTerrain;
  const around = (main: string): string => `${HEAD}${prelude}\n${terrain}\n${shading}\n${view}\n${main}`;
  return { skyline: around(`#define SKYLINE\n${march}`), march: around(march), correct: around(correct), shade: around(`${OVERLAY}${source ? '' : '#define SHADE_NEUTRAL\n'}${shade}`), heights: around(HEIGHTS) };
}
