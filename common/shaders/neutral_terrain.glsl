// Stands for a terrain file that is not to be had: ground that no ray meets.
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return -131072.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
