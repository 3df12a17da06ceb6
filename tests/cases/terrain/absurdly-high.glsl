float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return float(cell.x) * 4096.0 + fraction.x;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
