// alpine: ridged, eroded mountains with lakes, meadows, scree and snow.

const float snowLine = 1760.0f;  //! 500..4000 m: height of the snow line
const float treeLine = 1150.0f;  //! 300..3000 m: height up to which woods grow
const float kWaterLevel = 420.0f;

// One octave of ridges: where the noise crosses zero the ground peaks. The height's crest is sharp; the slope that later octaves follow
// turns gently there, so that their gullies run out below the crest. Returns also how near a crest this is, 0..1, in `ridge`.
struct Ridged {
  Place place;
  float ridge;
};
Ridged ridged(Place p, float wavelength, float high, uint salt) {
  vec3 n = gradientNoise(p.cell, p.at, salt);
  float crossing = held(n.x * 1.5f);
  float square = crossing * crossing;
  float sharp = square + 0.0006f;
  Ridged r;
  r.ridge = held(1.0f - sharp * inverseRoot(sharp));
  r.place = p;
  r.place.height += high * (r.ridge * r.ridge - 0.35f);
  float k = held(held(high * r.ridge * (crossing * inverseRoot(square + 0.006f))) * (1.0f / wavelength));
  r.place.slope = held(r.place.slope - held(vec2(n.y * k, n.z * k)) * 3.0f);
  return r;
}

// One octave of gullies, cut across the slope gathered so far: deep on faces, none on level ground.
Place cut(Place p, float wavelength, float deep, uint salt) {
  float steep2 = held(dot(p.slope, p.slope));
  float inverse = inverseRoot(steep2 + 0.05f);
  vec2 side = held(held(vec2(-p.slope.y * inverse, p.slope.x * inverse)) * 0.75f);
  vec2 s = stripes(p.cell, p.at, side, salt);
  float amount = held(held(steep2 * inverse * inverse) * deep);
  p.height += amount * (s.x - 0.3f);
  float k = held(held(s.y * amount) * (1.0f / wavelength));
  p.slope = held(p.slope + vec2(side.x * k, side.y * k));
  return p;
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  uint salt = mixedSeed(seed);
  Place p = widestPlace(cell, fraction);
  float broad = gradientNoise(p.cell, p.at, salt).x;
  float massif = min(max(broad * 1.35f + 0.58f, 0.0f), 1.0f);
  massif = held(massif * massif * (2.16f - 1.44f * massif) + 0.28f);
  p.height = 720.0f * massif;

  p = finer5(p);
  Ridged r = ridged(p, 7327.0f, held(massif * (octaveWeight(7327.0f, footprint) * 1900.0f)), salt + 1u);
  p = finer5(r.place);
  r = ridged(p, 3277.0f, held(held(massif * r.ridge) * (octaveWeight(3277.0f, footprint) * 1250.0f)), salt + 2u);

  p = finer5(r.place);
  p = cut(p, 1465.0f, octaveWeight(1465.0f, footprint) * 190.0f, salt + 3u);
  p = finer5(p);
  p = cut(p, 655.0f, octaveWeight(655.0f, footprint) * 94.0f, salt + 4u);
  p = finer5(p);
  p = cut(p, 293.0f, octaveWeight(293.0f, footprint) * 45.0f, salt + 5u);
  p = finer5(p);
  p = cut(p, 131.0f, octaveWeight(131.0f, footprint) * 20.0f, salt + 6u);

  // Crags on steep ground, boulders, turf and grit.
  float steep2 = held(dot(p.slope, p.slope));
  float inverse = inverseRoot(1.0f + steep2);
  float rough = held(steep2 * inverse * inverse) * 1.9f + 0.22f;
  p = finer10(p);
  float crag = held(abs(plainNoise(p.cell, p.at, salt + 7u)) * (octaveWeight(41.4f, footprint) * -8.0f));
  p = finer10(p);
  crag += held(abs(plainNoise(p.cell, p.at, salt + 8u)) * (octaveWeight(13.1f, footprint) * -2.8f));
  p = finer17(p);
  crag += held(plainNoise(p.cell, p.at, salt + 9u) * (octaveWeight(3.18f, footprint) * 0.55f));
  p = finer17(p);
  crag += held(plainNoise(p.cell, p.at, salt + 10u) * (octaveWeight(0.771f, footprint) * 0.11f));
  return max(held(p.height + held((held(crag) + 3.8f) * rough)) + 250.0f, kWaterLevel);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  if (height <= kWaterLevel + 0.005f) return vec3(0.02f, 0.055f, 0.075f);
  uint salt = mixedSeed(seed) + 64u;
  // Patches of 655 m (moisture), 58 m and, close by, 5.9 m and 0.6 m.
  Place p = finer5(finer5(finer5(finer5(widestPlace(cell, fraction)))));
  float moist = valueNoise(p.cell, p.at, salt).x * octaveWeight(655.0f, footprint);
  p = finer5(finer5(finer5(p)));
  float patches = valueNoise(p.cell, p.at, salt + 1u).x * octaveWeight(58.6f, footprint);
  p = finer10(finer10(p));
  float grain = valueNoise(p.cell, p.at, salt + 2u).x * octaveWeight(5.86f, footprint);
  p = finer10(finer10(p));
  float grit = valueNoise(p.cell, p.at, salt + 3u).x * octaveWeight(0.586f, footprint);
  float fine = 0.5f * grain + 0.5f * grit;
  float level = normal.y;

  // Rock in bands of its layers, slightly bent.
  float layer = height * 0.009f + moist * 1.1f + patches * 0.3f;
  float band = wave(layer) * 0.7f + wave(layer * 2.7f) * 0.3f * octaveWeight(60.0f, footprint);
  vec3 rock = mix(vec3(0.16f, 0.145f, 0.135f), vec3(0.27f, 0.24f, 0.21f), 0.5f + 0.5f * band);
  rock = rock * (1.0f + 0.5f * fine + 0.2f * patches);
  vec3 scree = vec3(0.30f, 0.28f, 0.25f) * (1.0f + 0.5f * grit + 0.25f * grain);
  vec3 c = mix(rock, scree, smoothstep(0.72f, 0.86f, level + 0.05f * patches));

  // Meadow and wood below the tree line, thin turf above it.
  float line = treeLine + 160.0f * moist + 60.0f * patches;
  vec3 meadow = mix(vec3(0.075f, 0.10f, 0.032f), vec3(0.135f, 0.125f, 0.06f), smoothstep(-500.0f, 100.0f, height - line) + 0.2f * patches);
  meadow = meadow * (1.0f + 0.25f * fine + 0.15f * patches);
  float green = smoothstep(0.74f, 0.86f, level + 0.06f * patches + 0.03f * fine) * (1.0f - smoothstep(-50.0f, 250.0f, height - line));
  c = mix(c, meadow, green);
  vec3 wood = vec3(0.030f, 0.052f, 0.020f) * (1.0f + 0.4f * fine + 0.2f * patches);
  float wooded = smoothstep(0.0f, 0.4f, moist * 0.7f + patches * 0.4f + fine * 0.3f) * smoothstep(0.62f, 0.72f, level) * (1.0f - smoothstep(-420.0f, -250.0f, height - line));
  c = mix(c, wood, wooded * 0.9f);
  // A shore of gravel.
  c = mix(vec3(0.24f, 0.22f, 0.18f) * (1.0f + 0.3f * fine), c, smoothstep(kWaterLevel + 1.5f, kWaterLevel + 5.0f, height + patches * 2.0f));

  // Snow where it is high and lies: less on steep faces, patches around the line.
  float snow = snowLine + 120.0f * moist + 70.0f * patches + 15.0f * fine;
  float lies = smoothstep(0.64f, 0.82f, level + 0.05f * fine + (height - snow) * 0.0002f);
  c = mix(c, vec3(0.60f, 0.64f, 0.70f) * (1.0f + 0.05f * patches + 0.04f * fine), smoothstep(-60.0f, 120.0f, height - snow) * lies);
  return c;
}
