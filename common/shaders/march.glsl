// The ray march that the mesh is measured against, in two programs. SKYLINE: the *skyline*, the highest ground by direction, a column for
// each sample, and by level distance, a row for each cell of an eighth of a doubling, sampled twice as densely as the picture. Without:
// the march, whose rays skip what they pass well above.
uniform vec2 skylineAhead;                    // level, of length 1: the direction of the sector's middle
uniform float skylineHalf, skylinePerRadian;  // radians: half the sector; columns
float marchHeight(vec2 offset) {
  ivec2 cell;
  vec2 fraction;
  viewLocate(offset, cell, fraction);
  return terrainHeight(cell, fraction, 0.0, viewSeed);
}
float skylineBegin(int cell) { return 4.0 * exp2(float(cell) / 8.0); }  // metres

#ifdef SKYLINE
layout(location = 0) out float highest;
void main() {
  float direction = (gl_FragCoord.x - 0.5) / skylinePerRadian - skylineHalf;
  vec2 ray = cos(direction) * skylineAhead + sin(direction) * viewRight.xz;
  int cell = int(gl_FragCoord.y);
  float from = skylineBegin(cell), to = skylineBegin(cell + 1), apart = 0.5 * viewFootprint(from);
  highest = -3.0e38;
  for (float at = from; at < to + apart; at += apart) highest = max(highest, marchHeight(ray * min(at, to)));
}
#else
uniform float marchLowest, marchHighest;  // metres: no ground within the horizon is lower or higher
uniform float marchFineness;              // divides every step; 1, or more for checking convergence
uniform sampler2D skyline;
layout(location = 0) out vec4 surface;

int skylineCell(float distance) { return int(floor(log2(distance / 4.0) * 8.0)); }
const int kHalvings = 14;

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

  float level = length(ray.xz);  // for each metre along the ray
  ivec2 last = textureSize(skyline, 0) - 1;
  int column = clamp(int(floor((atan(dot(ray.xz, viewRight.xz), dot(ray.xz, skylineAhead)) + skylineHalf) * skylinePerRadian)), 0, last.x);
  float t = near, above = near, below = 0.0;  // 0: no step has ended below the ground
  // Steps forwards, then the halvings of the last of them: one loop, since drivers put the terrain's function in at every call. Grazing
  // rays near the ground take the most steps: ln(far / near) / (0.2 / 700) is 40,000 at 720 lines.
  for (int k = 0, halvings = 0; k < 1000000 && halvings <= kHalvings; ++k) {
    float widest = far;
    if (below == 0.0 && level * t >= skylineBegin(0)) {
      int cell = min(skylineCell(level * t), last.y);
      float leaves = min(skylineBegin(cell + 1) / level, far);
      float ground = max(texelFetch(skyline, ivec2(column, cell), 0).r, texelFetch(skyline, ivec2(min(column + 1, last.x), cell), 0).r);
      // Between the places where the skyline was sampled the ground may be a little higher.
      if (viewCameraY + ray.y * (ray.y < 0.0 ? leaves : t) > ground + 2.0 * sampleWidth * t) {
        if (leaves >= far) return;
        above = t = max(leaves, t * 1.000001);
        continue;
      }
      widest = 0.5 * sampleWidth * t;  // no step over what is half a sample wide, however deep the ground before it
    }
    float gap = viewCameraY + ray.y * t - marchHeight(ray.xz * t);
    if (gap <= 0.0) below = t;
    else if (below == 0.0 && t >= far) return;
    else above = t;
    if (below > 0.0) {
      t = 0.5 * (above + below);
      ++halvings;
    } else {
      t = min(t + max(max(min(0.1 * gap, widest), 0.2 * sampleWidth * t), 0.005) / marchFineness, far);
    }
  }
  surface = vec4(ray * t, 1.0);
}
#endif
