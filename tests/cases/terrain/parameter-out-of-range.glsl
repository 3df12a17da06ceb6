const float steep = 7.0;  //! 0..5: how steep
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return steep;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
