float memory = 0.0;
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  memory = memory + 1.0;
  return memory;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
