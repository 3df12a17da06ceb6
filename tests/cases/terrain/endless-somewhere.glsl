// Endless in one square of 64.
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  int n = 0;
  for (;;) {
    if ((cell.x & 7) != 3 || (cell.y & 7) != 5) break;
    n = n + 1;
  }
  return float(n);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
