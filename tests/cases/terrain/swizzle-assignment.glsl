float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  vec2 p = fraction;
  p.yx = fraction;
  return p.x;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
