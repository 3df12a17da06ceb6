float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 1.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
int terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, uint seed) {
  float x = 0.0;
  while (x < 2.0 + height) x *= 0.5;
  return 5;
}
