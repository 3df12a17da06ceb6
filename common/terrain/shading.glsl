// What both renderings share: the filtered normal, light, sky, fog and the soft end of the world. Compiled after prelude.glsl and a
// terrain file. Colours are linear RGB until toDisplay.

const vec3 kSunDirection = vec3(0.5609701f, 0.5385313f, -0.6283046f);  // towards the sun; unit

// The height at an offset in metres from a place.
float heightNear(ivec2 cell, vec2 fraction, float dx, float dz, float footprint, uint seed) {
  vec2 f = vec2(fraction.x + dx * 0.000244140625f, fraction.y + dz * 0.000244140625f);
  vec2 whole = vec2(floor(f.x), floor(f.y));
  return terrainHeight(ivec2(cell.x + int(whole.x), cell.y + int(whole.y)), vec2(f.x - whole.x, f.y - whole.y), footprint, seed);
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

// The colour of the terrain's surface at a place in linear light, haze included. viewDirection: unit, from the eye to the point; distance:
// from the eye, metres; horizon: where the world ends, metres.
// All heights that it depends on in one loop: drivers put the terrain's function in at every call, and compile as long as there are calls.
vec3 shadeTerrain(ivec2 cell, vec2 fraction, float footprint, vec3 viewDirection, float distance, float horizon, uint seed) {
  float reach = floor(max(0.2f, 0.35f * footprint) * 256.0f + 0.5f) * 0.00390625f;  // whole steps
  float level = sqrt(kSunDirection.x * kSunDirection.x + kSunDirection.z * kSunDirection.z);
  float toSun = 20.0f + 2.0f * footprint;
  float height = 0.0f;
  vec3 normal = vec3(0.0f, 2.0f * reach, 0.0f);  // of the surface as seen at this footprint: central differences of filtered heights
  float open = 1.0f;  // to the sky, of which hollows see less: the height against its surroundings, 40 m and 300 m wide
  float sun = 1.0f;   // its share that comes past the terrain towards it, taken ever coarser with distance
  for (int i = 0; i < 16 && sun > 0.0f; ++i) {
    vec2 away = vec2(0.0f, 0.0f);
    float width = footprint;
    float side = (i & 1) == 0 ? reach : -reach;
    if (i == 0) width = 0.0f;
    else if (i < 3) away.x = side;
    else if (i < 5) away.y = side;
    else if (i < 7) width = max(footprint, i == 5 ? 60.0f : 500.0f);
    else {
      away = vec2(kSunDirection.x, kSunDirection.z) * (toSun / level);
      width = max(footprint, 0.22f * toSun);
    }
    float ground = heightNear(cell, fraction, away.x, away.y, width, seed);
    if (i == 0) height = ground;
    else if (i < 3) normal.x -= sign(side) * ground;
    else if (i < 5) normal.z -= sign(side) * ground;
    else if (i < 7) open -= (i == 5 ? 0.018f : 0.0022f) * (ground - height);
    else {
      float gap = height + toSun * kSunDirection.y / level - ground;
      sun = min(sun, 0.5f + gap / (0.16f * toSun + 4.0f));
      toSun = toSun * 1.75f;
    }
    if (i == 6 && dot(normal, kSunDirection) <= 0.0f) sun = 0.0f;
  }
  normal = normalize(normal);
  sun = smoothstep(0.0f, 1.0f, sun) * max(dot(normal, kSunDirection), 0.0f);
  open = min(max(open, 0.45f), 1.15f);
  vec3 light = vec3(2.75f, 2.4f, 1.9f) * sun;
  light += vec3(0.27f, 0.38f, 0.56f) * (open * (0.55f + 0.45f * normal.y));
  // What the sunlit ground around throws back, mostly onto faces turned away from the sun.
  light += vec3(0.16f, 0.14f, 0.11f) * (open * max(0.5f - 0.5f * dot(normal, vec3(kSunDirection.x, -0.3f, kSunDirection.z)), 0.0f));
  vec3 albedo = terrainColor(cell, fraction, height, normal, footprint, seed);
  return mix(skyColor(viewDirection), albedo * light, clearness(distance, horizon));
}

// Linear light to what a display takes: a filmic curve (Narkowicz's fit to ACES, 2015), then the display's gamma.
vec3 toDisplay(vec3 linear) {
  vec3 c = max(linear, vec3(0.0f)) * 0.56f;
  c = c * (c * 2.51f + 0.03f) / (c * (c * 2.43f + 0.59f) + 0.14f);
  return pow(min(c, vec3(1.0f)), vec3(0.4545454f));
}
