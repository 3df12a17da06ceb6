// canyon: a plateau of layered rock, cut into mesas, terraces and gorges, with a river at the bottom of the deepest.

const float riverLevel = 212.0f;  //! 0..600 m: height of the water

// One octave of the wide forms: adds its share to the height's field (x) and to the river's (y), with their slopes.
struct Forms {
  Place place;
  float field;
  float river;
  vec2 riverSlope;
};
Forms formed(Forms f, float wavelength, float toField, float toRiver, uint salt) {
  vec3 n = gradientNoise(f.place.cell, f.place.at, salt);
  f.field = held(f.field + held(n.x * toField));
  f.river = held(f.river + held(n.x * toRiver));
  float k = held(toField * (620.0f / wavelength));
  f.place.slope = held(f.place.slope + held(vec2(n.y * k, n.z * k)));
  float r = toRiver / wavelength;
  f.riverSlope = held(f.riverSlope + held(vec2(n.y * r, n.z * r)));
  return f;
}
Forms finerForms(Forms f) {
  f.place = finer5(f.place);
  f.riverSlope = held(vec2(f.riverSlope.x * 2.0f + f.riverSlope.y, f.riverSlope.y * 2.0f - f.riverSlope.x) * 0.4472136f);
  return f;
}

// One octave of gullies across the slope: flutes and buttresses on walls, washes on gentler ground.
Place fluted(Place p, float wavelength, float deep, uint salt) {
  float steep2 = held(dot(p.slope, p.slope));
  float inverse = inverseRoot(steep2 + 0.06f);
  vec2 side = held(held(vec2(-p.slope.y * inverse, p.slope.x * inverse)) * 0.8f);
  vec2 s = stripes(p.cell, p.at, side, salt);
  float amount = held(held(steep2 * inverse * inverse) * deep);
  p.height += amount * (s.x - 0.2f);
  float k = held(held(s.y * amount) * (1.0f / wavelength));
  p.slope = held(p.slope + vec2(side.x * k, side.y * k));
  return p;
}

// Layers of rock: benches where it is soft, cliffs where it is hard. `amount` 0 leaves the height as it is.
float terraced(float height, float perThickness, float thickness, float bench, float amount) {
  float u = held(height * perThickness);
  float k = floor(u);
  float t = held(u - k);
  float c = min(max(held(held(t - bench) * 2.2f), 0.0f), 1.0f);
  float s = held(held(t * 0.16f) + held(held(c * c * (3.0f - 2.0f * c)) * 0.84f));
  return held(height + held(held(held(s - t) * thickness) * amount));
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  uint salt = mixedSeed(seed) + 256u;
  Forms f;
  f.place = widestPlace(cell, fraction);
  f.field = 0.60f;
  f.river = 0.0f;
  f.riverSlope = vec2(0.0f, 0.0f);
  f = formed(f, 16384.0f, -0.50f, 1.0f, salt);
  f = finerForms(f);
  f = formed(f, 7327.0f, 1.05f, 0.42f, salt + 1u);
  float tilt = held(f.river * 60.0f);
  f = finerForms(f);
  f = formed(f, 3277.0f, octaveWeight(3277.0f, footprint) * 0.62f, octaveWeight(3277.0f, footprint) * 0.17f, salt + 2u);
  f = finerForms(f);
  f = formed(f, 1465.0f, octaveWeight(1465.0f, footprint) * 0.26f, octaveWeight(1465.0f, footprint) * 0.06f, salt + 3u);

  // The plateau is level above, the desert below; mesas stand between.
  float mesa = min(held(f.field), held(f.field * 0.07f) + 0.93f);
  mesa = max(mesa, held(f.field * 0.10f));
  // What the gullies follow changes from place to place without a jump: so does their depth.
  float beyond = max(held(f.field - 1.0f), held(-f.field));
  float steepness = min(max(held(0.6f - held(beyond * 9.0f)), 0.12f), 1.0f);
  float surface = held(430.0f + held(640.0f * mesa));
  // The gorge: walls fall from the surface to the river's bed.
  float bank = min(held(abs(f.river) * 6.0f), 1.0f);
  float wall = min(max(held(held(bank * 1.18f) - 0.07f), 0.0f), 1.0f);
  float open = held(held(wall * wall) * held(3.0f - 2.0f * wall));
  float bed = 226.0f;
  Place p = f.place;
  float channel = 1.0f - min(held(abs(f.river) * 50.0f), 1.0f);
  p.height = held(held(bed + held(held(surface - bed) * open)) - held(channel * 40.0f));
  float fall = held(held(surface - bed) * held(42.0f * held(wall * held(1.0f - wall))));
  fall = f.river < 0.0f ? -fall : fall;
  p.slope = held(held(p.slope * (steepness * open)) + held(f.riverSlope * fall));

  p = finer5(p);
  p = fluted(p, 655.0f, octaveWeight(655.0f, footprint) * 74.0f, salt + 4u);
  p = finer5(p);
  p = fluted(p, 293.0f, octaveWeight(293.0f, footprint) * 44.0f, salt + 5u);
  p = finer5(p);
  p = fluted(p, 131.0f, octaveWeight(131.0f, footprint) * 21.0f, salt + 6u);
  p = finer5(p);
  float knobs = held(plainNoise(p.cell, p.at, salt + 7u) * octaveWeight(58.6f, footprint));
  p.height = held(p.height + held(knobs * 5.0f));

  // Layers, gently tilted; the thick ones carry thinner ones.
  float h = held(p.height + tilt);
  float walls = min(held(wall * 3.0f), 1.0f);
  h = terraced(h, 0.0078125f, 128.0f, 0.50f, held(walls * (octaveWeight(400.0f, footprint) * 0.92f)));
  h = terraced(h, 0.03125f, 32.0f, 0.45f, held(walls * (octaveWeight(110.0f, footprint) * 0.62f)));
  h = held(h - tilt);

  // Blocks below the cliffs, ledges, sand.
  float steep2 = held(dot(p.slope, p.slope));
  float inverse = inverseRoot(1.0f + steep2);
  float rough = held(held(steep2 * inverse * inverse) * 1.4f) + 0.22f;
  p = finer10(p);
  float crag = held(abs(plainNoise(p.cell, p.at, salt + 8u)) * (octaveWeight(18.5f, footprint) * -4.2f));
  p = finer10(p);
  crag += held(abs(plainNoise(p.cell, p.at, salt + 9u)) * (octaveWeight(5.86f, footprint) * -1.1f));
  p = finer17(p);
  crag += held(plainNoise(p.cell, p.at, salt + 10u) * (octaveWeight(1.42f, footprint) * 0.16f));
  return max(held(h + held((held(crag) + 2.0f) * rough)), riverLevel);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  if (height <= riverLevel + 0.005f) return vec3(0.055f, 0.068f, 0.042f);
  uint salt = mixedSeed(seed) + 320u;
  Place p = finer5(widestPlace(cell, fraction));
  float broad = valueNoise(p.cell, p.at, salt).x;
  p = finer5(finer5(finer5(p)));
  float dry = valueNoise(p.cell, p.at, salt + 1u).x * octaveWeight(655.0f, footprint);
  p = finer5(finer5(finer5(p)));
  float patches = valueNoise(p.cell, p.at, salt + 2u).x * octaveWeight(58.6f, footprint);
  p = finer10(finer10(p));
  float grain = valueNoise(p.cell, p.at, salt + 3u).x * octaveWeight(5.86f, footprint);
  p = finer10(finer10(p));
  float grit = valueNoise(p.cell, p.at, salt + 4u).x * octaveWeight(0.586f, footprint);
  float fine = 0.5f * grain + 0.5f * grit;
  float level = normal.y;

  // Beds of rock: thick members of red, orange, cream and chocolate, each in thinner beds.
  float bed = height * 0.0078125f + broad * 0.5f + patches * 0.02f;
  float member = wave(bed * 0.5f + 0.1f) * 0.5f + wave(bed * 0.83f) * 0.5f;
  float beds = wave(bed * 4.3f) * 0.45f * octaveWeight(30.0f, footprint) + wave(bed * 11.7f + patches * 0.1f) * 0.3f * octaveWeight(11.0f, footprint) +
               wave(bed * 37.0f + patches * 0.2f) * 0.2f * octaveWeight(3.4f, footprint) +
             wave(height * 1.3f + grain * 0.35f + patches) * (0.2f + 0.2f * grain) * octaveWeight(0.8f, footprint);
  vec3 rock = mix(vec3(0.27f, 0.095f, 0.050f), vec3(0.42f, 0.22f, 0.115f), smoothstep(-0.5f, 0.45f, member + 0.5f * beds));
  rock = mix(rock, vec3(0.56f, 0.42f, 0.28f), smoothstep(0.42f, 0.85f, member + 0.35f * beds));
  rock = mix(rock, vec3(0.17f, 0.075f, 0.052f), smoothstep(0.55f, 1.1f, -member + 0.45f * beds));
  rock = rock * (1.0f + 0.42f * fine * smoothstep(0.2f, 0.7f, level) + 0.1f * fine + 0.10f * patches + 0.22f * beds);
  // Varnish runs down the steepest faces.
  float varnish = smoothstep(0.55f, 0.25f, level) * smoothstep(0.0f, 0.7f, dry + patches);
  rock = rock * (1.0f - 0.38f * varnish);

  // Rubble on slopes, sand and thin turf on level ground.
  vec3 rubble = mix(rock, vec3(0.36f, 0.20f, 0.12f), 0.6f) * (1.0f + 0.4f * grit + 0.22f * grain);
  vec3 c = mix(rock, rubble, smoothstep(0.62f, 0.80f, level + 0.06f * patches));
  vec3 sand = mix(vec3(0.43f, 0.25f, 0.14f), vec3(0.50f, 0.34f, 0.21f), 0.5f + 0.5f * dry) * (1.0f + 0.16f * fine + 0.06f * patches);
  c = mix(c, sand, smoothstep(0.86f, 0.97f, level + 0.04f * patches));
  // Sage and juniper in dots, thicker on the high plateau and in the washes.
  float high = smoothstep(820.0f, 1020.0f, height + 60.0f * dry);
  vec3 sage = mix(vec3(0.15f, 0.145f, 0.075f), vec3(0.085f, 0.10f, 0.045f), high) * (1.0f + 0.35f * fine);
  float grows = smoothstep(0.12f - 0.42f * high, 0.62f - 0.15f * high, dry * 0.55f + patches * 0.55f + grain * 0.45f + 0.12f) * smoothstep(0.80f, 0.93f, level);
  c = mix(c, sage, grows * 0.85f);
  // Green along the river, then its wet sand.
  float above = height - riverLevel + patches * 3.0f;
  vec3 willow = vec3(0.065f, 0.095f, 0.025f) * (1.0f + 0.45f * fine);
  c = mix(c, willow, (1.0f - smoothstep(6.0f, 22.0f, above)) * smoothstep(0.7f, 0.88f, level) * smoothstep(-0.5f, 0.1f, patches + dry));
  c = mix(vec3(0.30f, 0.20f, 0.12f) * (1.0f + 0.2f * fine), c, smoothstep(1.2f, 4.0f, above));
  return c;
}
