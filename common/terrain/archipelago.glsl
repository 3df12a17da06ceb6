// archipelago: wooded islands with hills, dunes and beaches in a shallow sea.

const float kSeaLevel = 0.0f;
const float heathLine = 520.0f;  //! 100..2000 m: height where woods end and heath begins

// One octave of the wide forms.
Place shaped(Place p, float wavelength, float high, uint salt) {
  vec3 n = gradientNoise(p.cell, p.at, salt);
  p.height = held(p.height + held(n.x * high));
  float k = held(high * (1.0f / wavelength));
  p.slope = held(p.slope + held(vec2(n.y * k, n.z * k)));
  return p;
}

// One octave of valleys across the slope.
Place drained(Place p, float wavelength, float deep, uint salt) {
  float steep2 = held(dot(p.slope, p.slope));
  float inverse = inverseRoot(steep2 + 0.05f);
  vec2 side = held(held(vec2(-p.slope.y * inverse, p.slope.x * inverse)) * 0.7f);
  vec2 s = stripes(p.cell, p.at, side, salt);
  float amount = held(held(steep2 * inverse * inverse) * deep);
  p.height += amount * (s.x - 0.15f);
  float k = held(held(s.y * amount) * (1.0f / wavelength));
  p.slope = held(p.slope + vec2(side.x * k, side.y * k));
  return p;
}

// The ground, under water too.
float groundHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  uint salt = mixedSeed(seed) + 512u;
  Place p = widestPlace(cell, fraction);
  p.height = -46.0f;
  p = shaped(p, 16384.0f, 330.0f, salt);
  p = finer5(p);
  p = shaped(p, 7327.0f, 400.0f, salt + 1u);
  p = finer5(p);
  p = shaped(p, 3277.0f, octaveWeight(3277.0f, footprint) * 210.0f, salt + 2u);
  float wind = min(max(held(p.height * 0.004f), -1.0f), 1.0f);  // turns a little from place to place
  p = finer5(p);
  // Inland the hills rise more and more steeply; level shelves lie under water.
  float inland = max(p.height, 0.0f);
  float rise = held(inland * 0.0052f);
  float grown = held(held(inland * 0.35f) + held(inland * min(rise, 2.2f)));
  p.slope = held(p.slope * held(0.35f + min(held(rise * 2.0f), 3.3f)));
  p.height = p.height < 0.0f ? held(p.height * 0.30f) : grown;
  float land = min(held(inland * 0.02f), 1.0f);
  float hills = min(held(inland * 0.009f), 1.0f);
  p = shaped(p, 1465.0f, held(octaveWeight(1465.0f, footprint) * held(18.0f + held(150.0f * hills))), salt + 3u);
  p = finer5(p);
  p = drained(p, 655.0f, held(octaveWeight(655.0f, footprint) * held(96.0f * hills)), salt + 4u);
  p = finer5(p);
  p = drained(p, 293.0f, held(octaveWeight(293.0f, footprint) * held(46.0f * hills)), salt + 5u);

  // Dunes behind the beaches: long crests across the wind, which join and fork.
  float low = held(land * held(1.0f - hills));
  float sandy = held(low * low) * 4.0f;
  p = finer5(p);
  vec2 across = held(vec2(0.62f + held(0.12f * wind), held(0.10f * wind) - 0.35f));
  float dune = held(stripes(p.cell, p.at, across, salt + 6u).x);
  p.height = held(p.height + held(held(held(sandy * 7.5f) * octaveWeight(131.0f, footprint)) * held(dune * 0.5f + 0.5f)));
  p = finer5(p);
  dune = held(stripes(p.cell, p.at, held(vec2(0.5f - held(0.1f * wind), 0.45f + held(0.1f * wind))), salt + 7u).x);
  p.height = held(p.height + held(held(held(held(sandy * 2.0f) + held(hills * 5.0f)) * octaveWeight(58.6f, footprint)) * dune));

  // A beach: what rises from the water begins level.
  float h = p.height;
  float above = max(h, 0.0f);
  float gentle = held(above * 0.12f);
  float shore = held(held(min(gentle, 1.0f) * min(gentle, 1.0f)) * held(3.0f - 2.0f * min(gentle, 1.0f)));
  h = h > 0.0f ? held(above * held(0.22f + held(0.78f * shore))) : h;

  // Rocks in the hills, tussocks, ripples.
  float steep2 = held(dot(p.slope, p.slope));
  float inverse = inverseRoot(1.0f + steep2);
  float rough = held(held(held(steep2 * inverse * inverse) * 1.4f) * hills) + 0.10f;
  p = finer10(p);
  float crag = held(abs(plainNoise(p.cell, p.at, salt + 8u)) * (octaveWeight(18.5f, footprint) * -5.0f));
  p = finer10(p);
  crag += held(plainNoise(p.cell, p.at, salt + 9u) * (octaveWeight(5.86f, footprint) * 1.3f));
  p = finer17(p);
  float ripple = held(stripes(p.cell, p.at, held(vec2(0.9f + held(0.2f * wind), held(0.2f * wind) - 0.4f)), salt + 10u).x);
  crag += held(held(ripple * held(1.0f - hills)) * (octaveWeight(1.42f, footprint) * 0.18f));
  return held(h + held(held(held(crag) + 1.6f) * held(rough * min(held(above * 0.25f), 1.0f))));
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return max(groundHeight(cell, fraction, footprint, seed), kSeaLevel);
}

// About exp(-v), v >= 0: light that water leaves.
float leftAfter(float v) { return 1.0f / (1.0f + v * (1.0f + v * (0.5f + v * 0.2f))); }

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  uint salt = mixedSeed(seed) + 576u;
  Place p = finer5(finer5(finer5(finer5(widestPlace(cell, fraction)))));
  float moist = valueNoise(p.cell, p.at, salt).x * octaveWeight(655.0f, footprint);
  p = finer5(finer5(finer5(p)));
  if (height <= kSeaLevel + 0.005f) {
    // Shallows are turquoise over sand and reefs, the deep is blue.
    float deep = max(-groundHeight(cell, fraction, max(footprint, 6.0f), seed), 0.0f);
    float reef = gradientNoise(p.cell, p.at, salt + 4u).x * octaveWeight(58.6f, footprint);
    p = finer5(p);
    reef = reef * 1.1f + gradientNoise(p.cell, p.at, salt + 5u).x * octaveWeight(26.2f, footprint) * 0.7f + moist * 0.5f;
    reef = smoothstep(0.05f, 0.75f, reef) * smoothstep(0.7f, 2.5f, deep) * (1.0f - smoothstep(6.0f, 14.0f, deep));
    vec3 bottom = mix(vec3(0.36f, 0.38f, 0.29f), vec3(0.12f, 0.16f, 0.10f), reef);
    vec3 left = vec3(leftAfter(0.55f * deep), leftAfter(0.15f * deep), leftAfter(0.105f * deep));
    return vec3(0.006f, 0.045f, 0.085f) + bottom * left * 0.85f;
  }
  float patches = valueNoise(p.cell, p.at, salt + 1u).x * octaveWeight(58.6f, footprint);
  p = finer10(finer10(p));
  float grain = valueNoise(p.cell, p.at, salt + 2u).x * octaveWeight(5.86f, footprint);
  p = finer10(finer10(p));
  float grit = valueNoise(p.cell, p.at, salt + 3u).x * octaveWeight(0.586f, footprint);
  float fine = 0.5f * grain + 0.5f * grit;
  float level = normal.y;

  vec3 sand = mix(vec3(0.56f, 0.47f, 0.33f), vec3(0.62f, 0.55f, 0.42f), 0.5f + 0.5f * patches) * (1.0f + 0.07f * fine);
  vec3 c = mix(vec3(0.33f, 0.27f, 0.19f), sand, smoothstep(0.12f, 0.7f, height + 0.15f * patches));
  // Marram on the dunes in tufts, then heath and meadow.
  float marram = smoothstep(-0.1f, 0.5f, patches * 0.5f + grain * 0.55f + moist * 0.4f + 0.16f * smoothstep(4.0f, 14.0f, height)) * smoothstep(2.0f, 4.5f, height);
  c = mix(c, vec3(0.19f, 0.20f, 0.085f) * (1.0f + 0.3f * fine), marram * 0.8f);
  float green = smoothstep(9.0f, 26.0f, height + 7.0f * moist + 5.0f * patches);
  vec3 meadow = mix(vec3(0.13f, 0.14f, 0.052f), vec3(0.17f, 0.145f, 0.065f), smoothstep(-0.2f, 0.7f, patches - moist)) * (1.0f + 0.25f * fine + 0.12f * patches);
  c = mix(c, meadow, green * smoothstep(0.66f, 0.80f, level));
  // Woods in the hollows and up the hills, heath above.
  vec3 wood = mix(vec3(0.028f, 0.050f, 0.019f), vec3(0.060f, 0.082f, 0.030f), 0.5f + 0.5f * patches) * (1.0f + 0.5f * fine);
  float wooded = smoothstep(-0.25f, 0.25f, moist * 0.8f + patches * 0.45f + fine * 0.25f + 0.22f) * smoothstep(22.0f, 46.0f, height + 10.0f * moist) *
                 (1.0f - smoothstep(-50.0f, 40.0f, height - heathLine + 60.0f * moist)) * smoothstep(0.60f, 0.74f, level);
  c = mix(c, wood, wooded);
  vec3 heath = mix(vec3(0.13f, 0.11f, 0.06f), vec3(0.15f, 0.085f, 0.085f), smoothstep(0.0f, 0.6f, patches)) * (1.0f + 0.3f * fine);
  c = mix(c, heath, smoothstep(-50.0f, 60.0f, height - heathLine + 60.0f * moist) * smoothstep(0.62f, 0.76f, level));
  // Bare rock where it is steep: dark and volcanic, in beds.
  float bed = wave(height * 0.021f + moist * 0.7f) * 0.6f + wave(height * 0.083f + patches * 0.3f) * 0.4f * octaveWeight(14.0f, footprint);
  vec3 rock = mix(vec3(0.115f, 0.10f, 0.09f), vec3(0.21f, 0.18f, 0.15f), 0.5f + 0.5f * bed) * (1.0f + 0.45f * fine + 0.15f * patches);
  return mix(rock, c, smoothstep(0.56f, 0.72f, level + 0.07f * patches + 0.03f * moist));
}
