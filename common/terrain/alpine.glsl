// alpine: ridged, eroded mountains with lakes, meadows, scree and snow.

const float kWaterLevel = 420.0f;

// One octave of gullies, cut across the slope gathered so far: deep on faces, none on level ground.
Place cut(Place p, float wavelength, float depth, float weight, uint salt) {
  float steep2 = dot(p.slope, p.slope);
  float inverse = 1.0f / sqrt(steep2 + 0.02f);
  vec2 side = vec2(-p.slope.y, p.slope.x) * (inverse * 0.75f);
  vec2 s = stripes(p.cell, p.at, side, salt);
  float amount = weight * depth * steep2 * inverse * inverse;
  p.height += amount * (s.x - 0.3f);
  p.slope += side * (-6.2f * s.y * amount / wavelength);
  return p;
}

// One octave of boulders, turf and grit, rougher on steep ground.
Place roughen(Place p, float wavelength, float size, float rough, float weight, uint salt) {
  vec3 n = valueNoise(p.cell, p.at, salt);
  p.height += weight * size * rough * n.x;
  return p;
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  uint salt = mixedSeed(seed);
  Place p = widestPlace(cell, fraction);
  vec3 n = gradientNoise(p.cell, p.at, salt);
  float massif = min(max(n.x * 0.9f + 0.5f, 0.0f), 1.0f);
  massif = 0.2f + 0.8f * massif * massif * (3.0f - 2.0f * massif);
  p.height = 330.0f + 500.0f * massif;
  p.slope = vec2(n.y, n.z) * (400.0f / 16384.0f);

  p = finer5(p);
  float w = octaveWeight(7327.0f, footprint);
  n = gradientNoise(p.cell, p.at, salt + 1u);
  float s = sqrt(n.x * n.x + 0.0008f);
  float ridge = 1.0f - s;
  float k = w * 1500.0f * massif;
  float shape = ridge * ridge;
  p.height += k * (shape * ridge - 0.1f);
  p.slope += vec2(n.y, n.z) * (k * -3.0f * shape * n.x / (s * 7327.0f));

  p = finer5(p);
  w = octaveWeight(3277.0f, footprint);
  n = gradientNoise(p.cell, p.at, salt + 2u);
  s = sqrt(n.x * n.x + 0.0008f);
  k = w * 1000.0f * massif * ridge;
  ridge = 1.0f - s;
  p.height += k * (ridge * ridge - 0.4f);
  p.slope += vec2(n.y, n.z) * (k * -2.0f * ridge * n.x / (s * 3277.0f));

  p = finer5(p);
  p = cut(p, 1465.0f, 150.0f, octaveWeight(1465.0f, footprint), salt + 3u);
  p = finer5(p);
  p = cut(p, 655.0f, 75.0f, octaveWeight(655.0f, footprint), salt + 4u);
  p = finer5(p);
  p = cut(p, 293.0f, 36.0f, octaveWeight(293.0f, footprint), salt + 5u);
  p = finer5(p);
  p = cut(p, 131.0f, 16.0f, octaveWeight(131.0f, footprint), salt + 6u);
  p = finer5(p);
  float steep2 = dot(p.slope, p.slope);
  float rough = 0.25f + 1.5f * steep2 / (1.0f + steep2);
  p = roughen(p, 58.6f, 4.0f, rough, octaveWeight(58.6f, footprint), salt + 7u);
  p = finer10(p);
  p = roughen(p, 18.5f, 1.6f, rough, octaveWeight(18.5f, footprint), salt + 8u);
  p = finer10(p);
  p = roughen(p, 5.86f, 0.6f, rough, octaveWeight(5.86f, footprint), salt + 9u);
  p = finer10(p);
  p = roughen(p, 1.85f, 0.2f, rough, octaveWeight(1.85f, footprint), salt + 10u);
  p = finer10(p);
  p = roughen(p, 0.586f, 0.06f, rough, octaveWeight(0.586f, footprint), salt + 11u);
  return max(p.height, kWaterLevel);
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
  float flat_ = normal.y;

  // Rock in bands of its layers, slightly bent.
  float layer = height * 0.011f + moist * 0.8f + patches * 0.25f;
  float band = wave(layer) * 0.6f + wave(layer * 3.7f) * 0.4f * octaveWeight(40.0f, footprint);
  vec3 rock = mix(vec3(0.16f, 0.145f, 0.135f), vec3(0.27f, 0.24f, 0.21f), 0.5f + 0.5f * band);
  rock = rock * (1.0f + 0.25f * fine + 0.12f * patches);
  vec3 scree = vec3(0.30f, 0.28f, 0.25f) * (1.0f + 0.3f * grit + 0.15f * grain);
  vec3 c = mix(rock, scree, smoothstep(0.70f, 0.84f, flat_ + 0.05f * patches));

  // Meadow and wood below the tree line, thin turf above it.
  float line = 1150.0f + 160.0f * moist + 60.0f * patches;
  vec3 meadow = mix(vec3(0.105f, 0.135f, 0.035f), vec3(0.16f, 0.15f, 0.06f), smoothstep(-500.0f, 100.0f, height - line) + 0.2f * patches);
  meadow = meadow * (1.0f + 0.25f * fine + 0.15f * patches);
  float green = smoothstep(0.74f, 0.86f, flat_ + 0.06f * patches + 0.03f * fine) * (1.0f - smoothstep(-50.0f, 250.0f, height - line));
  c = mix(c, meadow, green);
  vec3 wood = vec3(0.030f, 0.052f, 0.020f) * (1.0f + 0.4f * fine + 0.2f * patches);
  float wooded = smoothstep(0.0f, 0.35f, moist * 0.7f + patches * 0.5f) * smoothstep(0.62f, 0.72f, flat_) * (1.0f - smoothstep(-420.0f, -250.0f, height - line));
  c = mix(c, wood, wooded * 0.9f);
  // A shore of gravel.
  c = mix(vec3(0.24f, 0.22f, 0.18f) * (1.0f + 0.3f * fine), c, smoothstep(kWaterLevel + 1.5f, kWaterLevel + 5.0f, height + patches * 2.0f));

  // Snow where it is high and lies: less on steep faces, patches around the line.
  float snowLine = 1500.0f + 120.0f * moist + 70.0f * patches + 15.0f * fine;
  float lies = smoothstep(0.58f, 0.76f, flat_ + 0.03f * fine + (height - snowLine) * 0.0002f);
  c = mix(c, vec3(0.80f, 0.83f, 0.88f), smoothstep(-60.0f, 120.0f, height - snowLine) * lies);
  return c;
}
