//! crescents of sand, one upon the other
const float tallest = 260.0;  //! 20..1500 m: height of the largest dunes

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  Place p = finer5(finer5(widestPlace(cell, fraction)));
  float height = 0.0, size = tallest, wavelength = 3277.0;
  for (int octave = 0; octave < 7; ++octave) {
    float crest = 1.0 - abs(valueNoise(p.cell, p.at, mixedSeed(seed) + uint(octave)).x);
    height += crest * crest * size * octaveWeight(wavelength, footprint);
    p = finer5(p);
    size *= 0.42;
    wavelength *= 0.4472;
  }
  return height;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return mix(vec3(0.30, 0.19, 0.10), vec3(0.52, 0.37, 0.21), smoothstep(0.6, 1.0, normal.y));
}
