float hills(vec2 at, int n) {
  return n > 0 ? hills(at * 2.0, n - 1) * 0.5 : at.x;
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return hills(fraction, 5);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
