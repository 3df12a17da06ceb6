// The shaders: GLSL ES 3.00 around the terrain's own functions, which arrive with the world. Texts that are common to all clients
// (noise, light, sky) come from common/terrain, as PROTOCOL.md says.

import prelude from '../../../../common/terrain/prelude.glsl?raw';
import shading from '../../../../common/terrain/shading.glsl?raw';

const HEAD = 'precision highp float;\nprecision highp int;\nprecision highp sampler2D;\n';

// Ground that no ray meets, for worlds whose text is not to be had.
const NEUTRAL_TERRAIN = `
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return -131072.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
`;

// Cells and steps are integers relative to the camera's cell: the only rounding is that of the offset from the camera, a float.
const VIEW = `
uniform ivec2 viewCell;        // the camera's cell of 2^20 steps
uniform ivec2 viewSteps;       // its steps inside the cell
uniform vec2 viewRemainder;    // and the rest, in steps
uniform float viewCameraY;
uniform vec3 viewForward, viewRight, viewUp;
uniform vec2 viewTangents;     // of the half angles, horizontal and vertical
uniform vec2 viewSize;         // of the picture, in samples
uniform float viewHorizon;
uniform uint viewSeed;

void viewLocate(vec2 offset, out ivec2 cell, out vec2 fraction) {
  ivec2 steps = viewSteps + ivec2(floor(offset * 256.0 + viewRemainder));
  cell = viewCell + (steps >> 20);
  fraction = vec2(steps & 0xfffff) * (1.0 / 1048576.0);
}
vec3 viewRay(vec2 sampleAt) {
  vec2 s = (sampleAt / viewSize * 2.0 - 1.0) * viewTangents;
  return normalize(viewForward + s.x * viewRight + s.y * viewUp);
}
float viewFootprint(float depth) { return depth * 2.0 * viewTangents.y / viewSize.y; }
`;

/** One triangle that covers the picture, without any buffer. */
export const FULL_SCREEN = `${HEAD}
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }
`;

// Integers up to the camera's own step: as exact 10^12 m out as at the origin, and neighbours cannot crack. The depth is logarithmic:
// it spreads 0.1 m to 200 km evenly.
export const MESH_VERTEX = `${HEAD}
in ivec3 position;       // x, z, y in steps, x and z from the leaf's corner
uniform ivec3 leafOffset;  // what to add for steps from the camera's own step
uniform vec3 remainder;    // of the camera: x, z, y, in steps
uniform vec3 viewForward, viewRight, viewUp;
uniform vec2 viewTangents;
out vec3 offset;
out vec3 corner;
out float depth;
void main() {
  vec3 metres = (vec3(position + leafOffset) - remainder) * (1.0 / 256.0);
  offset = metres.xzy;
  int k = gl_VertexID % 3;
  corner = vec3(k == 0, k == 1, k == 2);
  depth = dot(offset, viewForward);
  gl_Position = vec4(dot(offset, viewRight) / viewTangents.x, dot(offset, viewUp) / viewTangents.y, depth - 0.2, depth);
}
`;
// w is 1 + the leaf's level + half of how much of this sample is an edge of a triangle.
export const MESH_FRAGMENT = `${HEAD}
uniform float leafLevel;
uniform float edges;
in vec3 offset;
in vec3 corner;
in float depth;
layout(location = 0) out vec4 surface;
void main() {
  vec3 wide = fwidth(corner);
  vec3 near = 1.0 - smoothstep(0.6 * wide, 1.3 * wide, corner);
  float edge = max(near.x, max(near.y, near.z)) * (1.0 - smoothstep(0.25, 0.9, max(wide.x, max(wide.y, wide.z))));
  surface = vec4(offset, 1.0 + leafLevel + 0.498 * edge * edges);
  gl_FragDepth = clamp(log2(max(depth, 0.1) * 10.0) / log2(2000000.0), 0.0, 1.0);
}
`;

// A dot is shown whole or not at all: its middle decides. A little behind what is seen is still seen.
export const DOT_VERTEX = `${HEAD}
in vec3 position;  // metres from the camera
in vec3 paint;
uniform sampler2D dotSurface;
uniform vec3 viewForward, viewRight, viewUp;
uniform vec2 viewTangents;
uniform float viewHorizon, dotSize;
out vec3 dotPaint;
out float dotAlpha;
void main() {
  float depth = dot(position, viewForward);
  vec2 at = vec2(dot(position, viewRight), dot(position, viewUp)) / viewTangents / max(depth, 1.0e-3);
  ivec2 samples = textureSize(dotSurface, 0);
  vec4 s = texelFetch(dotSurface, clamp(ivec2((at * 0.5 + 0.5) * vec2(samples)), ivec2(0), samples - 1), 0);
  bool hidden = s.w > 0.0 && depth > dot(s.xyz, viewForward) * 1.02 + 0.2;
  dotPaint = paint;
  dotAlpha = 1.0 - smoothstep(0.4, 0.9, length(position) / viewHorizon);
  gl_Position = depth < 0.1 || hidden ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(at, 0.0, 1.0);
  gl_PointSize = dotSize;
}
`;
export const DOT_FRAGMENT = `${HEAD}
uniform float dotSize;
in vec3 dotPaint;
in float dotAlpha;
layout(location = 0) out vec4 colour;
void main() {
  float away = length(gl_PointCoord - 0.5) * dotSize;  // samples from the middle
  if (away > 0.5 * dotSize) discard;
  colour = vec4(mix(dotPaint, vec3(0.02), dotSize < 4.5 ? 0.0 : 0.8 * smoothstep(0.5 * dotSize - 1.1, 0.5 * dotSize - 0.4, away)), dotAlpha);
}
`;

// The picture that the mesh is measured against; the same march as the desktop client's.
const MARCH = `
uniform float marchLowest, marchHighest;
layout(location = 0) out vec4 surface;

float marchGap(vec3 offset) {
  ivec2 cell;
  vec2 fraction;
  viewLocate(offset.xz, cell, fraction);
  return viewCameraY + offset.y - terrainHeight(cell, fraction, 0.0, viewSeed);
}

void main() {
  surface = vec4(0.0);
  vec3 ray = viewRay(gl_FragCoord.xy);
  float sampleWidth = viewFootprint(dot(ray, viewForward));  // for each metre along the ray
  float near = 0.1, far = viewHorizon;
  float air = marchHighest - viewCameraY;  // how far below the highest ground the camera is
  if (air < 0.0) {
    if (ray.y >= 0.0) return;
    near = max(near, air / ray.y);
  } else if (ray.y > 0.0) {
    far = min(far, air / ray.y);
  }
  if (ray.y < 0.0) far = min(far, (marchLowest - viewCameraY) / ray.y);
  if (near >= far) return;

  float t = near, above = near;
  float gap = marchGap(ray * t);
  for (int k = 0; k < 1000000 && gap > 0.0 && t < far; ++k) {
    above = t;
    t = min(t + max(max(0.1 * gap, 0.2 * sampleWidth * t), 0.005), far);
    gap = marchGap(ray * t);
  }
  if (gap > 0.0) return;
  float below = t;
  for (int k = 0; k < 14; ++k) {
    float middle = 0.5 * (above + below);
    if (marchGap(ray * middle) > 0.0) above = middle; else below = middle;
  }
  surface = vec4(ray * (0.5 * (above + below)), 1.0);
}
`;

// What is drawn over the ground's display values: triangles' edges, and the squares of the leaves, tinted by level as in the desktop client
// (viridis, by Nathaniel Smith and Stefan van der Walt: it grows in brightness alone).
const OVERLAY = `
uniform float showNodes;
vec3 levelColour(float level) {
  vec3 ramp[6] = vec3[6](vec3(0.993, 0.906, 0.144), vec3(0.478, 0.821, 0.318), vec3(0.133, 0.659, 0.518), vec3(0.164, 0.471, 0.558), vec3(0.254, 0.265, 0.530), vec3(0.267, 0.005, 0.329));
  float at = clamp(level / 10.0, 0.0, 1.0) * 5.0;
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
  return mix(shown, vec3(0.02, 0.03, 0.05), 0.55 * min(1.0, fract(s.w) * 2.0));
}
`;

// The height that colours depend on is the terrain's own, not the mesh's: what is left between the two renderings is where the surface
// is, not how it is painted.
const SHADE = `
uniform sampler2D shadeSurface;
layout(location = 0) out vec4 colour;
void main() {
  vec4 s = texelFetch(shadeSurface, ivec2(gl_FragCoord.xy), 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light;
  if (ground) {
    ivec2 cell;
    vec2 fraction;
    viewLocate(s.xz, cell, fraction);
    float height = terrainHeight(cell, fraction, 0.0, viewSeed);
    light = shadeTerrain(cell, fraction, height, viewFootprint(dot(s.xyz, viewForward)), s.xyz / max(range, 1e-6), range, viewHorizon, viewSeed);
  } else {
    light = skyColor(viewRay(gl_FragCoord.xy));
  }
  colour = vec4(ground ? overlaid(toDisplay(light), s, range) : toDisplay(light), 1.0);
}
`;

// Without the terrain's functions: the normal of the mesh, from the positions beside this one (the nearer of the two on each axis), and
// a ramp of heights.
const NEUTRAL_SHADE = `
uniform sampler2D shadeSurface;
layout(location = 0) out vec4 colour;
vec3 along(vec3 here, ivec2 at, ivec2 one) {
  ivec2 last = textureSize(shadeSurface, 0) - 1;
  vec4 after = texelFetch(shadeSurface, min(at + one, last), 0);
  vec4 before = texelFetch(shadeSurface, max(at - one, ivec2(0)), 0);
  vec3 forwards = after.xyz - here;
  vec3 backwards = here - before.xyz;
  bool first = after.w > 0.0 && at + one == min(at + one, last);
  bool second = before.w > 0.0 && at - one == max(at - one, ivec2(0));
  return first && (!second || dot(forwards, forwards) < dot(backwards, backwards)) ? forwards : backwards;
}
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 s = texelFetch(shadeSurface, at, 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light;
  if (ground) {
    vec3 normal = cross(along(s.xyz, at, ivec2(1, 0)), along(s.xyz, at, ivec2(0, 1)));
    normal = dot(normal, normal) > 0.0 ? normalize(normal) : vec3(0.0, 1.0, 0.0);
    if (normal.y < 0.0) normal = -normal;
    float height = viewCameraY + s.y;
    vec3 ramp = mix(vec3(0.16, 0.20, 0.10), vec3(0.33, 0.29, 0.18), smoothstep(0.0, 800.0, height));
    ramp = mix(ramp, vec3(0.34, 0.33, 0.32), smoothstep(800.0, 1700.0, height));
    ramp = mix(ramp, vec3(0.62), smoothstep(1700.0, 3200.0, height));
    light = ramp * (vec3(2.6, 2.3, 1.9) * max(dot(normal, kSunDirection), 0.0) + vec3(0.30, 0.38, 0.50) * (0.6 + 0.4 * normal.y));
    light = mix(skyColor(s.xyz / max(range, 1e-6)), light, clearness(range, viewHorizon));
  } else {
    light = skyColor(viewRay(gl_FragCoord.xy));
  }
  colour = vec4(ground ? overlaid(toDisplay(light), s, range) : toDisplay(light), 1.0);
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
export function terrainShaders(source: string): { march: string; shade: string; heights: string } {
  const around = (main: string): string => `${HEAD}${prelude}\n${source || NEUTRAL_TERRAIN}\n${shading}\n${VIEW}${OVERLAY}${main}`;
  return { march: around(MARCH), shade: around(source ? SHADE : NEUTRAL_SHADE), heights: around(HEIGHTS) };
}
