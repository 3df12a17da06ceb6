float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  float h = 1.0;
  while (h > 0.0) {
    h += 1.0;
  }
  return h;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
