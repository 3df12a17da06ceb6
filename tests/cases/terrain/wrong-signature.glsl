// Positions in metres do not reach far.
float terrainHeight(vec2 metres) {
  return metres.x * 0.1;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
