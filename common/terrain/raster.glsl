// A height map as a terrain. Before this text stand (terrain::rasterSource):
//   const int rasterPitch              steps between samples
//   const float rasterPitchMetres, rasterPitchInverse (1 / steps), rasterLowest, rasterHighest (metres)
// and before those, from whoever compiles it, the window of samples around the camera that it holds:
//   ivec2 rasterBaseCell, rasterBaseSteps   where the window's first sample lies: the cell, and steps inside it
//   int rasterTexel(ivec2 index, int level) the sample `index` from there in steps, in the pyramid's level (each the mean of 2 x 2 of
//                                           the one before, 0 to 7); below -2^24 where the window does not reach
// and, if it holds the picture on a draped map, RASTER_DRAPED and
//   vec4 rasterPicture(vec2 index, float footprint)   light times alpha, and alpha, in the window as above; footprint: in samples, at least 1

const float kUnknownHeight = -131072.0f;  // what lies outside the window: so deep that no ray meets it

float rasterSmooth(ivec2 steps, int level) {
  int size = rasterPitch << level;
  ivec2 from = steps - ivec2((size - rasterPitch) >> 1);  // a sample of a coarser level stands in the middle of those it was made of
  if (from.x < size || from.y < size) return kUnknownHeight;
  ivec2 index = ivec2(int(uint(from.x) / uint(size)), int(uint(from.y) / uint(size)));
  float inverse = rasterPitchInverse * uintBitsToFloat(uint(127 - level) << 23u);  // / 2^level, exactly
  // Held, or drivers merge its constant with those that it is multiplied by next.
  vec2 t = held(vec2(float(from.x - index.x * size) * inverse, float(from.y - index.y * size) * inverse));
  ivec4 row[4];
  ivec4 least = ivec4(0);
  for (int j = 0; j < 4; ++j) {
    ivec2 first = index + ivec2(-1, j - 1);
    row[j] = ivec4(rasterTexel(first, level), rasterTexel(first + ivec2(1, 0), level), rasterTexel(first + ivec2(2, 0), level),
                   rasterTexel(first + ivec2(3, 0), level));
    least = min(least, row[j]);
  }
  if (min(min(least.x, least.y), min(least.z, least.w)) < -16777216) return kUnknownHeight;
  return rasterCubic(row[0], row[1], row[2], row[3], t);
}

ivec2 rasterStepsTo(ivec2 cell, vec2 fraction) {
  ivec2 inside = ivec2(int(floor(fraction.x * 1048576.0f)), int(floor(fraction.y * 1048576.0f)));
  return (cell - rasterBaseCell) * 1048576 + inside - rasterBaseSteps;
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  ivec2 steps = rasterStepsTo(cell, fraction);
  float detail = footprint / rasterPitchMetres;
  if (detail <= 0.5f) return rasterSmooth(steps, 0);
  float level = min(log2(detail) + 1.0f, 7.0f);
  int finer = int(level);
  float low = rasterSmooth(steps, finer);
  float part = level - float(finer);
  if (part <= 0.0f || low <= kUnknownHeight) return low;
  float high = rasterSmooth(steps, finer + 1);
  return high <= kUnknownHeight ? low : mix(low, high, part);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  vec3 own = rasterColor(cell, fraction, height, normal, footprint, seed, rasterLowest, rasterHighest);
#ifdef RASTER_DRAPED
  vec4 picture = rasterPicture(vec2(rasterStepsTo(cell, fraction)) * rasterPitchInverse, max(footprint / rasterPitchMetres, 1.0f));
  own = own * (1.0f - picture.a) + picture.rgb;
#endif
  return own;
}
