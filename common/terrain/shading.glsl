// What both renderings share: the filtered normal, light, sky, fog and the soft end of the world. Compiled after prelude.glsl and a
// terrain file. Colours are linear RGB until toDisplay.

const vec3 kSunDirection = vec3(0.5609701f, 0.5385313f, -0.6283046f);  // towards the sun; unit

// The height at an offset in metres from a place.
float heightNear(ivec2 cell, vec2 fraction, float dx, float dz, float footprint, uint seed) {
  vec2 f = vec2(fraction.x + dx * 0.000244140625f, fraction.y + dz * 0.000244140625f);
  vec2 whole = vec2(floor(f.x), floor(f.y));
  return terrainHeight(ivec2(cell.x + int(whole.x), cell.y + int(whole.y)), vec2(f.x - whole.x, f.y - whole.y), footprint, seed);
}

// Unit normal of the surface as seen at this footprint: central differences of filtered heights, whole steps apart. In a loop: drivers
// put the terrain's function in at every call, and compile as long as there are calls.
vec3 terrainNormal(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  float reach = max(0.2f, 0.35f * footprint);
  reach = floor(reach * 256.0f + 0.5f) * 0.00390625f;
  float x = 0.0f;
  float z = 0.0f;
  for (int i = 0; i < 4; ++i) {
    float side = (i & 1) == 0 ? -1.0f : 1.0f;
    float ground = heightNear(cell, fraction, i < 2 ? side * reach : 0.0f, i < 2 ? 0.0f : side * reach, footprint, seed);
    if (i < 2) x -= side * ground; else z -= side * ground;
  }
  return normalize(vec3(x, 2.0f * reach, z));
}

// The sky in a unit direction (+Y up).
vec3 skyColor(vec3 direction) {
  float up = max(direction.y, 0.0f);
  float toSun = max(dot(direction, kSunDirection), 0.0f);
  vec3 sky = mix(vec3(0.56f, 0.68f, 0.82f), vec3(0.12f, 0.26f, 0.55f), 1.0f - exp(-4.0f * up));
  return sky + vec3(1.0f, 0.8f, 0.5f) * (0.12f * pow(toSun, 6.0f) + 0.6f * pow(toSun, 400.0f));
}

// Share of the surface that is left at a distance: more than nine tenths at half the horizon, nothing at the horizon.
float clearness(float distance, float horizon) {
  float t = min(distance / horizon, 1.0f);
  float haze = 1.0f - 0.09f * min(t * 2.0f, 1.0f) * min(t * 2.0f, 1.0f);
  return haze * (1.0f - smoothstep(0.5f, 1.0f, t));
}

// Share of the sun that reaches a point: the terrain towards the sun, ever coarser with distance, against the sun's ray.
float sunlight(ivec2 cell, vec2 fraction, float height, float footprint, uint seed) {
  float open = 1.0f;
  float reach = 20.0f + 2.0f * footprint;
  float level = sqrt(kSunDirection.x * kSunDirection.x + kSunDirection.z * kSunDirection.z);
  for (int i = 0; i < 9; ++i) {
    float coarse = max(footprint, 0.22f * reach);
    float ground = heightNear(cell, fraction, reach * kSunDirection.x / level, reach * kSunDirection.z / level, coarse, seed);
    float gap = height + reach * kSunDirection.y / level - ground;
    open = min(open, 0.5f + gap / (0.16f * reach + 4.0f));
    if (open <= 0.0f) break;
    reach = reach * 1.75f;
  }
  return smoothstep(0.0f, 1.0f, open);
}

// The colour of a surface with this height and normal in linear light, fog included. viewDirection: unit, from the eye to the point;
// distance: from the eye, metres; horizon: where the world ends, metres.
vec3 shadeGroundAt(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, vec3 viewDirection, float distance, float horizon,
                   uint seed) {
  vec3 albedo = terrainColor(cell, fraction, height, normal, footprint, seed);
  // Hollows see less of the sky: the height against its surroundings, 40 m and 300 m wide.
  float open = 1.0f;
  for (int i = 0; i < 2; ++i) {
    float around = terrainHeight(cell, fraction, max(footprint, i == 0 ? 60.0f : 500.0f), seed) - height;
    open -= (i == 0 ? 0.018f : 0.0022f) * around;
  }
  open = min(max(open, 0.45f), 1.15f);
  float facing = dot(normal, kSunDirection);
  float sun = max(facing, 0.0f);
  if (sun > 0.0f) sun = sun * sunlight(cell, fraction, height, footprint, seed);
  vec3 light = vec3(2.75f, 2.4f, 1.9f) * sun;
  light += vec3(0.27f, 0.38f, 0.56f) * (open * (0.55f + 0.45f * normal.y));
  // What the sunlit ground around throws back, mostly onto faces turned away from the sun.
  light += vec3(0.16f, 0.14f, 0.11f) * (open * max(0.5f - 0.5f * dot(normal, vec3(kSunDirection.x, -0.3f, kSunDirection.z)), 0.0f));
  return mix(skyColor(viewDirection), albedo * light, clearness(distance, horizon));
}

// The same of the terrain's own surface.
vec3 shadeTerrain(ivec2 cell, vec2 fraction, float height, float footprint, vec3 viewDirection, float distance, float horizon, uint seed) {
  return shadeGroundAt(cell, fraction, height, terrainNormal(cell, fraction, footprint, seed), footprint, viewDirection, distance, horizon,
                       seed);
}

// Linear light to what a display takes: a filmic curve (Narkowicz's fit to ACES, 2015), then the display's gamma.
vec3 toDisplay(vec3 linear) {
  vec3 c = max(linear, vec3(0.0f)) * 0.56f;
  c = c * (c * 2.51f + 0.03f) / (c * (c * 2.43f + 0.59f) + 0.14f);
  return pow(min(c, vec3(1.0f)), vec3(0.4545454f));
}
