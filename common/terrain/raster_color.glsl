// The colour of a height map, by height between its lowest and highest sample, slope and a little noise.
vec3 rasterColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed, float lowest, float highest) {
  // Where between the lowest and the highest sample, ragged by noise of 60 m and 11 m.
  Place wide = finer17(finer17(finer17(finer5(widestPlace(cell, fraction)))));
  Place small = finer5(finer5(wide));
  float ragged = valueNoise(wide.cell, wide.at, mixedSeed(seed)).x * octaveWeight(104.0f, footprint) +
                 0.6f * valueNoise(small.cell, small.at, mixedSeed(seed) + 7u).x * octaveWeight(21.0f, footprint);
  float up = (height - lowest) / max(highest - lowest, 1.0f) + 0.03f * ragged;
  vec3 ground = mix(vec3(0.11f, 0.16f, 0.06f), vec3(0.07f, 0.12f, 0.05f), smoothstep(0.1f, 0.3f, up));
  ground = mix(ground, vec3(0.20f, 0.19f, 0.09f), smoothstep(0.35f, 0.55f, up));
  ground = mix(ground, vec3(0.26f, 0.24f, 0.21f), smoothstep(0.55f, 0.72f, up));
  ground = mix(ground, vec3(0.75f, 0.79f, 0.85f), smoothstep(0.76f, 0.86f, up) * smoothstep(0.55f, 0.8f, normal.y));
  vec3 rock = mix(vec3(0.23f, 0.20f, 0.17f), vec3(0.29f, 0.27f, 0.26f), 0.5f + 0.5f * ragged);
  return mix(ground, rock, 1.0f - smoothstep(0.66f, 0.80f, normal.y + 0.04f * ragged)) * (1.0f + 0.12f * ragged);
}
