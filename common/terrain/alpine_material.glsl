// What the ground is made of where terrainColor, seen from close by, shows mostly that. A text of its own: the terrain's own is part of its
// worlds' hashes.
const int kWater = 9;
const int kWood = 10;

int terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, uint seed) {
  if (height <= kWaterLevel + 0.005f) return kWater;
  uint salt = mixedSeed(seed) + 64u;
  Place p = finer5(finer5(finer5(finer5(widestPlace(cell, fraction)))));
  float moist = valueNoise(p.cell, p.at, salt).x;
  p = finer5(finer5(finer5(p)));
  float patches = valueNoise(p.cell, p.at, salt + 1u).x;
  p = finer10(finer10(p));
  float grain = valueNoise(p.cell, p.at, salt + 2u).x;
  p = finer10(finer10(p));
  float fine = 0.5f * grain + 0.5f * valueNoise(p.cell, p.at, salt + 3u).x;
  float level = normal.y;
  float snow = snowLine + 120.0f * moist + 70.0f * patches + 15.0f * fine;
  float lies = smoothstep(0.64f, 0.82f, level + 0.05f * fine + (height - snow) * 0.0002f);
  if (smoothstep(-60.0f, 120.0f, height - snow) * lies > 0.5f) return kSnow;
  if (smoothstep(kWaterLevel + 1.5f, kWaterLevel + 5.0f, height + patches * 2.0f) < 0.5f) return kGravel;
  float line = treeLine + 160.0f * moist + 60.0f * patches;
  float wooded = smoothstep(0.0f, 0.4f, moist * 0.7f + patches * 0.4f + fine * 0.3f) * smoothstep(0.62f, 0.72f, level) * (1.0f - smoothstep(-420.0f, -250.0f, height - line));
  if (wooded * 0.9f > 0.5f) return kWood;
  float green = smoothstep(0.74f, 0.86f, level + 0.06f * patches + 0.03f * fine) * (1.0f - smoothstep(-50.0f, 250.0f, height - line));
  if (green > 0.5f) return kGrass;
  return smoothstep(0.72f, 0.86f, level + 0.05f * patches) > 0.5f ? kGravel : kRock;
}
