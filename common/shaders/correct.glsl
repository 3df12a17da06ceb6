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

// Two places along a ray on the two sides of the ground, and how far each is above it.
struct Crossing {
  float from, over, to, under;
};

// Where the ground is, to a part of a sample's width.
float correctClose(vec3 ray, Crossing c, float width) {
  float best = c.from;
  for (int k = 0; k < kClosingSteps; ++k) {  // false position, the end that stays counting half (Illinois)
    best = mix(c.from, c.to, c.over / (c.over - c.under));
    float there = correctGap(ray * best);
    if (abs(there) < 0.03 * width) break;
    if (there * c.under < 0.0) {
      c.from = c.to;
      c.over = c.under;
    } else {
      c.over *= 0.5;
    }
    c.to = best;
    c.under = there;
  }
  return best;
}

// Ground that the mesh lacks may hide what it shows here: if much nearer ground begins up to kOutstanding samples below, the ray is
// searched from there on. Returns whether it is hidden, by what, and the nearer ground's w. (Tuned on alpine at 8 pixels: 0.9 for 0.975
// saves a tenth of the time and costs 0.015 SSIM.)
bool correctBefore(vec3 ray, ivec2 at, float shown, out Crossing hides, out float whose) {
  float nearest = shown;
  whose = 0.0;
  for (int k = 1; k <= kOutstanding; k *= 2) {
    vec4 below = texelFetch(correctSurface, max(at - ivec2(0, k), ivec2(0)), 0);
    float away = length(below.xyz);
    if (below.w == 0.0 || away >= nearest) continue;
    nearest = away;
    whose = below.w;
  }
  hides = Crossing(0.0, 0.0, 0.97 * nearest, 0.0);
  if (nearest > 0.975 * shown) return false;
  float part = viewFootprint(dot(ray, viewForward));
  for (int k = 0; k <= kSearchSteps; ++k) {
    hides.under = correctGap(ray * hides.to);
    if (hides.under <= 0.0) return k > 0;
    hides.from = hides.to;
    hides.over = hides.under;
    hides.to = hides.from + max(0.6 * hides.over, 2.0 * part * hides.from);
    // As far again as ground that begins there may reach, and up to what is shown.
    if (hides.to > min(1.15 * nearest, 0.99 * shown)) return false;
  }
  return false;
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  surface = texelFetch(correctSurface, at, 0);
  if (correctSteps == 0) return;
  vec3 ray = viewRay(gl_FragCoord.xy);
  Crossing crossing;
  float whose, width;
  if (correctBefore(ray, at, surface.w > 0.0 ? length(surface.xyz) : viewHorizon, crossing, whose)) {
    surface.w = floor(whose);  // a fraction is the mesh's own
    width = viewFootprint(dot(ray, viewForward)) * crossing.to;
  } else {
    if (surface.w == 0.0) return;
    float began = length(surface.xyz);
    ray = surface.xyz / began;
    vec4 across = correctAlong(surface.xyz, at, ivec2(1, 0)), upwards = correctAlong(surface.xyz, at, ivec2(0, 1));
    vec3 normal = cross(across.xyz, upwards.xyz);
    // How fast the gap closes for each metre along the ray, were the ground the mesh's plane.
    float fall = across.w * upwards.w > 0.0 && abs(normal.y) > 1.0e-6 * length(normal) ? dot(ray, normal) / normal.y : ray.y;
    bool facing = fall < -0.05;  // else the plane says nothing: a silhouette, or ground seen along itself
    fall = min(fall, -0.02);
    width = viewFootprint(dot(surface.xyz, viewForward));
    float longest = kMaxSamples * width / -fall;
    float t = began, next = began, best = began, first = 0.0, gap = 0.0, least = 3.0e38;
    for (int k = 0; k < correctSteps; ++k) {
      float there = correctGap(ray * next);
      if (k == 0) first = there;
#ifdef RASTER  // beyond what is known of a height map the mesh is all there is
      if (k == 0 && viewCameraY + surface.y - there <= kUnknownHeight) return;
#endif
      float slope = next != t ? min((there - gap) / (next - t), 0.25 * fall) : fall;
      t = next;
      gap = there;
      next = t + clamp(-gap / slope, -longest, longest);
      if (abs(gap) > abs(least)) continue;
      best = k + 1 == correctSteps ? next : t;
      least = gap;
    }
    if (facing && abs(least) <= 0.05 * width && (best - began) * first >= 0.0) {
      surface.xyz = ray * max(best, 0.05);
      return;
    }
    float stride = clamp(abs(first), width, kMaxSamples * width), way = sign(first);
    crossing = Crossing(began, first, began, first);
    for (int k = 0; k < kSearchSteps && crossing.over * crossing.under > 0.0; ++k) {
      crossing.from = crossing.to;
      crossing.over = crossing.under;
      crossing.to = max(crossing.from + way * stride, 0.05);
      crossing.under = correctGap(ray * crossing.to);
      // In clear air by the height above ground, as a ray march does.
      stride = max(min(1.5 * stride, 4.0 * kMaxSamples * width), 0.3 * crossing.under);
      if (way < 0.0 ? k == kBackSteps || crossing.to <= 0.05 : crossing.to > viewHorizon) break;
    }
    if (crossing.over == crossing.under || crossing.over * crossing.under > 0.0) {
      if (crossing.to > viewHorizon) surface = vec4(0.0);
      return;
    }
  }
  surface.xyz = ray * max(correctClose(ray, crossing, width), 0.05);
}
