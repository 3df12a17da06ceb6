// Moves the mesh's samples along their rays onto the true surface. RASTER: the ground is a height map.
// The mesh's plane gives the slope of the first step, the last two heights that of the others. A slope counts as at least a quarter of the
// mesh's, and a step is at most what lifts the ground by kMaxSamples samples' widths.
// The steps fail if they do not end within a sample's width of the ground, if they end on the wrong side of their start, or if the mesh is
// seen edge on. Then the ray is searched from the mesh on, with growing steps: forwards above the ground, backwards below it. A crossing is
// then located precisely. Where the mesh rises above the ground, the ray so reaches what lies behind, or the sky. Without a crossing the
// mesh's own point stays.
uniform sampler2D correctSurface;  // of the mesh; w is 0 for sky, and for ground 1 or more
uniform int correctSteps;          // heights a sample where the mesh is near the ground; 0: it stays
layout(location = 0) out vec4 surface;  // w is the mesh's

const float kMaxSamples = 8.0;
const int kBackSteps = 7, kSearchSteps = 32, kClosingSteps = 5, kOutstanding = 8;

float correctGap(vec3 offset) {
  ivec2 cell;
  vec2 fraction;
  viewLocate(offset.xz, cell, fraction);
  return viewCameraY + offset.y - terrainHeight(cell, fraction, 0.0, viewSeed);
}

// From here to the nearer of the two samples beside it on an axis; w: 0 when both are sky.
vec4 correctAlong(vec3 here, ivec2 at, ivec2 next) {
  ivec2 last = textureSize(correctSurface, 0) - 1;
  vec4 after = texelFetch(correctSurface, min(at + next, last), 0);
  vec4 before = texelFetch(correctSurface, max(at - next, ivec2(0)), 0);
  vec3 forwards = after.xyz - here, backwards = here - before.xyz;
  float f = after.w > 0.0 && dot(forwards, forwards) > 0.0 ? dot(forwards, forwards) : 3.0e38;
  float b = before.w > 0.0 && dot(backwards, backwards) > 0.0 ? dot(backwards, backwards) : 3.0e38;
  return vec4(f < b ? forwards : backwards, min(f, b) < 3.0e38 ? 1.0 : 0.0);
}

// Between two places along a ray on the two sides of the ground: where it is, to a part of a sample's width.
float correctClose(vec3 ray, float from, float over, float to, float under, float width) {
  float best = from;
  for (int k = 0; k < kClosingSteps; ++k) {  // false position, the end that stays counting half (Illinois)
    best = mix(from, to, over / (over - under));
    float there = correctGap(ray * best);
    if (abs(there) < 0.03 * width) break;
    if (there * under < 0.0) {
      from = to;
      over = under;
    } else {
      over *= 0.5;
    }
    to = best;
    under = there;
  }
  return best;
}

// Ground that the mesh lacks may hide what it shows here: if much nearer ground begins up to kOutstanding samples below, the ray is
// searched from there on. Returns where along the ray (0: nothing hides it), and the nearer ground's w. (Tuned on alpine at 8 pixels: 0.9
// for 0.975 saves a tenth of the time and costs 0.015 SSIM.)
vec2 correctBefore(vec3 ray, ivec2 at, float shown) {
  float nearest = shown, whose = 0.0;
  for (int k = 1; k <= kOutstanding; k *= 2) {
    vec4 below = texelFetch(correctSurface, max(at - ivec2(0, k), ivec2(0)), 0);
    float away = length(below.xyz);
    if (below.w == 0.0 || away >= nearest) continue;
    nearest = away;
    whose = below.w;
  }
  if (nearest > 0.975 * shown) return vec2(0.0);
  float part = viewFootprint(dot(ray, viewForward)), from = 0.97 * nearest, over = correctGap(ray * from);
  for (int k = 0; k < kSearchSteps && over > 0.0; ++k) {
    float to = from + max(0.6 * over, 2.0 * part * from);
    // As far again as ground that begins there may reach, and up to what is shown.
    if (to > min(1.15 * nearest, 0.99 * shown)) return vec2(0.0);
    float under = correctGap(ray * to);
    if (under <= 0.0) return vec2(correctClose(ray, from, over, to, under, part * to), whose);
    from = to;
    over = under;
  }
  return vec2(0.0);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  surface = texelFetch(correctSurface, at, 0);
  if (correctSteps == 0) return;
  vec3 ray = viewRay(gl_FragCoord.xy);
  vec2 before = correctBefore(ray, at, surface.w > 0.0 ? length(surface.xyz) : viewHorizon);
  if (before.x > 0.0) {
    surface = vec4(ray * before.x, floor(before.y));  // a fraction is the mesh's own
    return;
  }
  if (surface.w == 0.0) return;
  float t = length(surface.xyz);
  ray = surface.xyz / t;
  vec4 across = correctAlong(surface.xyz, at, ivec2(1, 0)), upwards = correctAlong(surface.xyz, at, ivec2(0, 1));
  vec3 normal = cross(across.xyz, upwards.xyz);
  // How fast the gap closes for each metre along the ray, were the ground the mesh's plane.
  float fall = across.w * upwards.w > 0.0 && abs(normal.y) > 1.0e-6 * length(normal) ? dot(ray, normal) / normal.y : ray.y;
  bool facing = fall < -0.05;  // else the plane says nothing: a silhouette, or ground seen along itself
  fall = min(fall, -0.02);
  float width = viewFootprint(dot(surface.xyz, viewForward)), longest = kMaxSamples * width / -fall;
  float slope = fall, best = t, gap = correctGap(surface.xyz), least = gap;
#ifdef RASTER  // beyond what is known of a height map the mesh is all there is
  if (viewCameraY + surface.y - gap <= kUnknownHeight) return;
#endif
  float began = t, first = gap;
  for (int k = 1; k <= correctSteps; ++k) {
    float next = t + clamp(-gap / slope, -longest, longest);
    if (k == correctSteps) {
      if (abs(gap) <= abs(least)) best = next;
      break;
    }
    float there = correctGap(ray * next);
    slope = next != t ? min((there - gap) / (next - t), 0.25 * fall) : fall;
    t = next;
    gap = there;
    if (abs(gap) <= abs(least)) {
      best = t;
      least = gap;
    }
  }
  if (!facing || abs(least) > 0.05 * width || (best - began) * first < 0.0) {
    best = began;
    float from = began, over = first, stride = clamp(abs(first), width, kMaxSamples * width), way = sign(first);
    float to = from, under = over;
    for (int k = 0; k < kSearchSteps && over * under > 0.0; ++k) {
      from = to;
      over = under;
      to = max(from + way * stride, 0.05);
      under = correctGap(ray * to);
      // In clear air by the height above ground, as a ray march does.
      stride = max(min(1.5 * stride, 4.0 * kMaxSamples * width), 0.3 * under);
      if (way < 0.0 ? k == kBackSteps || to <= 0.05 : to > viewHorizon) break;
    }
    if (over * under > 0.0 && to > viewHorizon) {
      surface = vec4(0.0);
      return;
    }
    if (over * under <= 0.0 && over != under) best = correctClose(ray, from, over, to, under, width);
  }
  surface.xyz = ray * max(best, 0.05);
}
