//! materials: mud, grass
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 1.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
