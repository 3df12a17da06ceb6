// The root of a negative number where fraction.x is small.
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return 400.0 * sqrt(fraction.x - 0.01);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
