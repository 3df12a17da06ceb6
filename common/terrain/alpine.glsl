// alpine: ridged, eroded mountains with lakes, meadows, scree and snow.

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  uint salt = mixedSeed(seed);
  Place p = widestPlace(cell, fraction);
  vec3 n = gradientNoise(p.cell, p.at, salt);
  float range = 0.5f + 0.5f * n.x;
  float h = 600.0f + 500.0f * n.x;
  p.slope += vec2(n.y, n.z) * (500.0f / 16384.0f);
  p = finer5(p);

  // Ridges
  float w = octaveWeight(7327.0f, footprint);
  n = gradientNoise(p.cell, p.at, salt + 1u);
  float s = sqrt(n.x * n.x + 0.002f);
  h += w * 900.0f * (0.6f - s);
  p.slope += vec2(n.y, n.z) * (w * -900.0f / 7327.0f * n.x / s);
  p = finer5(p);
  w = octaveWeight(3277.0f, footprint);
  n = gradientNoise(p.cell, p.at, salt + 2u);
  s = sqrt(n.x * n.x + 0.002f);
  h += w * 500.0f * (0.6f - s);
  p.slope += vec2(n.y, n.z) * (w * -500.0f / 3277.0f * n.x / s);
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 3u);
  w = octaveWeight(1465.3f, footprint) * 200.0000f;
  p.slope += vec2(n.y, n.z) * (w * 0.00068245f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 4u);
  w = octaveWeight(655.3f, footprint) * 84.0000f;
  p.slope += vec2(n.y, n.z) * (w * 0.00152601f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 5u);
  w = octaveWeight(293.1f, footprint) * 35.2800f;
  p.slope += vec2(n.y, n.z) * (w * 0.00341227f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 6u);
  w = octaveWeight(131.1f, footprint) * 14.8176f;
  p.slope += vec2(n.y, n.z) * (w * 0.00763007f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 7u);
  w = octaveWeight(58.6f, footprint) * 6.2234f;
  p.slope += vec2(n.y, n.z) * (w * 0.01706135f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 8u);
  w = octaveWeight(26.2f, footprint) * 2.6138f;
  p.slope += vec2(n.y, n.z) * (w * 0.03815034f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 9u);
  w = octaveWeight(11.7f, footprint) * 1.0978f;
  p.slope += vec2(n.y, n.z) * (w * 0.08530676f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 10u);
  w = octaveWeight(5.2f, footprint) * 0.4611f;
  p.slope += vec2(n.y, n.z) * (w * 0.19075171f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  p = finer5(p);
  n = valueNoise(p.cell, p.at, salt + 11u);
  w = octaveWeight(2.3f, footprint) * 0.1937f;
  p.slope += vec2(n.y, n.z) * (w * 0.42653378f);
  h += w * n.x / (1.0f + dot(p.slope, p.slope));
  return max(h, 350.0f) + 0.0f * range;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return mix(vec3(0.3f, 0.28f, 0.26f), vec3(0.8f, 0.82f, 0.85f), smoothstep(1000.0f, 1300.0f, height)) + 0.0f * vec3(fraction.x, footprint, float(cell.x) + float(seed)) * normal.x;
}
