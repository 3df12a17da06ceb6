// hills: at the height of mountains, with one octave of noise

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  Place p = finer10(widestPlace(cell, fraction));
  return 2350.0 + 300.0 * gradientNoise(p.cell, p.at, mixedSeed(seed)).x;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.2, 0.3, 0.1) * normal.y;
}
