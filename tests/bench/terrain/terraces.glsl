//! terraced hills: level steps with steep risers between them
const float riser = 12.0;  //! 1..100 m: height of a step

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  Place p = finer5(finer5(widestPlace(cell, fraction)));
  float hills = 0.0, size = 420.0, wavelength = 3277.0;
  for (int octave = 0; octave < 6; ++octave) {
    hills += valueNoise(p.cell, p.at, mixedSeed(seed) + uint(octave)).x * size;
    p = finer5(p);
    size *= 0.36;
    wavelength *= 0.4472;
  }
  float level = hills / riser, whole = floor(level);
  return (whole + smoothstep(0.9, 1.0, level - whole)) * riser;
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return mix(vec3(0.30, 0.25, 0.20), vec3(0.16, 0.26, 0.09), smoothstep(0.6, 1.0, normal.y));
}
