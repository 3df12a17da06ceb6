// As alpine_material.glsl.
const int kWater = 9;
const int kScrub = 10;

int terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, uint seed) {
  if (height <= riverLevel + 0.005f) return kWater;
  uint salt = mixedSeed(seed) + 320u;
  Place p = finer5(finer5(finer5(finer5(widestPlace(cell, fraction)))));
  float dry = valueNoise(p.cell, p.at, salt + 1u).x;
  p = finer5(finer5(finer5(p)));
  float patches = valueNoise(p.cell, p.at, salt + 2u).x;
  p = finer10(finer10(p));
  float grain = valueNoise(p.cell, p.at, salt + 3u).x;
  float level = normal.y;
  float above = height - riverLevel + patches * 3.0f;
  if (smoothstep(1.2f, 4.0f, above) < 0.5f) return kSand;
  if ((1.0f - smoothstep(6.0f, 22.0f, above)) * smoothstep(0.7f, 0.88f, level) * smoothstep(-0.5f, 0.1f, patches + dry) > 0.5f) return kScrub;
  float high = smoothstep(820.0f, 1020.0f, height + 60.0f * dry);
  float grows = smoothstep(0.12f - 0.42f * high, 0.62f - 0.15f * high, dry * 0.55f + patches * 0.55f + grain * 0.45f + 0.12f) * smoothstep(0.80f, 0.93f, level);
  if (grows * 0.85f > 0.5f) return kScrub;
  if (smoothstep(0.86f, 0.97f, level + 0.04f * patches) > 0.5f) return kSand;
  return smoothstep(0.62f, 0.80f, level + 0.06f * patches) > 0.5f ? kGravel : kRock;
}
