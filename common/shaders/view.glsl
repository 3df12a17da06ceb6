// A camera in a world. Cells and steps are integers relative to the camera's cell, so that nothing is ever far from anything: the only
// rounding is that of the offset from the camera, a float.
uniform ivec2 viewCell;        // the camera's cell of 2^20 steps
uniform ivec2 viewSteps;       // its steps inside the cell
uniform vec2 viewRemainder;    // and the rest, in steps
uniform float viewCameraY;     // metres
uniform vec3 viewForward, viewRight, viewUp;  // unit vectors
uniform vec2 viewTangents;     // of the half angles, horizontal and vertical
uniform vec2 viewSize;         // of the picture, in samples
uniform float viewHorizon;     // metres
uniform uint viewSeed;
uniform float viewFiltered;    // 1 or 0

// Where an offset from the camera lies; metres, x and z.
void viewLocate(vec2 offset, out ivec2 cell, out vec2 fraction) {
  ivec2 steps = viewSteps + ivec2(floor(offset * 256.0 + viewRemainder));
  cell = viewCell + (steps >> 20);
  fraction = vec2(steps & 0xfffff) * (1.0 / 1048576.0);
}
// The unit direction through gl_FragCoord.xy.
vec3 viewRay(vec2 sampleAt) {
  vec2 s = (sampleAt / viewSize * 2.0 - 1.0) * viewTangents;
  return normalize(viewForward + s.x * viewRight + s.y * viewUp);
}
// The width in metres of a sample at this depth along the axis, and what colours there are filtered by: the same, or 0.
float viewFootprint(float depth) { return depth * 2.0 * viewTangents.y / viewSize.y; }
float viewFilter(float depth) { return viewFiltered * viewFootprint(depth); }
