// As alpine_material.glsl.
const int kWater = 9;
const int kWood = 10;
const int kHeath = 11;

int terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, uint seed) {
  if (height <= kSeaLevel + 0.005f) return kWater;
  uint salt = mixedSeed(seed) + 576u;
  Place p = finer5(finer5(finer5(finer5(widestPlace(cell, fraction)))));
  float moist = valueNoise(p.cell, p.at, salt).x;
  p = finer5(finer5(finer5(p)));
  float patches = valueNoise(p.cell, p.at, salt + 1u).x;
  p = finer10(finer10(p));
  float grain = valueNoise(p.cell, p.at, salt + 2u).x;
  p = finer10(finer10(p));
  float fine = 0.5f * grain + 0.5f * valueNoise(p.cell, p.at, salt + 3u).x;
  float level = normal.y;
  if (smoothstep(0.56f, 0.72f, level + 0.07f * patches + 0.03f * moist) < 0.5f) return kRock;
  if (smoothstep(-50.0f, 60.0f, height - heathLine + 60.0f * moist) * smoothstep(0.62f, 0.76f, level) > 0.5f) return kHeath;
  float wooded = smoothstep(-0.25f, 0.25f, moist * 0.8f + patches * 0.45f + fine * 0.25f + 0.22f) * smoothstep(22.0f, 46.0f, height + 10.0f * moist) *
                 (1.0f - smoothstep(-50.0f, 40.0f, height - heathLine + 60.0f * moist)) * smoothstep(0.60f, 0.74f, level);
  if (wooded > 0.5f) return kWood;
  float green = smoothstep(9.0f, 26.0f, height + 7.0f * moist + 5.0f * patches);
  float marram = smoothstep(-0.1f, 0.5f, patches * 0.5f + grain * 0.55f + moist * 0.4f + 0.16f * smoothstep(4.0f, 14.0f, height)) * smoothstep(2.0f, 4.5f, height);
  if (green * smoothstep(0.66f, 0.80f, level) > 0.5f || marram * 0.8f > 0.5f) return kGrass;
  return kSand;
}
