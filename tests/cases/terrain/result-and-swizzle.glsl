float turned(inout vec2 v) {
  v = v.yx; return v.x; }
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { vec2 p = fraction; return p.x + turned(p.yx); }

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
