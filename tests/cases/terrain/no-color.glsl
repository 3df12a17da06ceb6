float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return 12.0;
}
