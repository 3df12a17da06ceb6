// A height map as a terrain. Before this text stand (terrain::rasterSource):
//   const ivec2 rasterPitch, rasterPitchParts   steps between samples along x and z, and parts of a step beyond them, 2^-20
//   const vec2 rasterPitchInverse               1 / steps
//   const float rasterPitchMetres               of the finer
//   const float rasterLowest, rasterHighest     metres
// and before those, from whoever compiles it, the window of samples around the camera that it holds:
//   ivec2 rasterBaseCell, rasterBaseSteps, rasterBaseParts   where the window's first sample lies: the cell, steps inside it, and parts of
//                                           a step behind them
//   int rasterTexel(ivec2 index, int level) the sample `index` from there in steps, in the pyramid's level (each the mean of 2 x 2 of
//                                           the one before, 0 to 7); below -2^24 where the window does not reach
// and, if it holds the picture on a draped map, RASTER_DRAPED and
//   vec4 rasterPicture(vec2 index, float footprint)   light times alpha, and alpha, in the window as above; footprint: in samples, >= 1

const float kUnknownHeight = -131072.0f;  // what lies outside the window: so deep that no ray meets it

// Along one axis, on samples `pitch` steps and `parts` parts apart, the first of them `firstParts` parts behind step 0: the sample before
// `from`, and which part of the way to the next `from` lies beyond it.
int rasterBefore(int from, int pitch, int parts, int firstParts, float inverse, out float t) {
  int k = int(float(from) * inverse) + 1;  // or one less, or two: floats are off by less than one
  uint beyond = uint(firstParts) + uint(k) * uint(parts);
  for (int n = 0; n < 2; ++n) {
    if (from - k * pitch - int(beyond >> 20u) >= ((beyond & 1048575u) > 0u ? 1 : 0)) break;
    --k;
    beyond -= uint(parts);
  }
  float steps = float(from - k * pitch - int(beyond >> 20u)) - float(int(beyond & 1048575u)) * 9.5367431640625e-7f;
  t = held(steps * inverse);  // held, or drivers merge its constant with those that it is multiplied by next
  return k;
}

float rasterSmooth(ivec2 steps, int level) {
  ivec2 parts = rasterPitchParts << level;  // of a pitch of this level, and its steps
  ivec2 size = (rasterPitch << level) + (parts >> 20);
  parts &= 1048575;
  // A sample of a coarser level stands in the middle of those it was made of.
  int others = (1 << level) - 1;
  ivec2 from = steps - ((rasterPitch * others + ((rasterPitchParts * others) >> 20)) >> 1);
  if (from.x < size.x || from.y < size.y) return kUnknownHeight;
  vec2 inverse = rasterPitchInverse * uintBitsToFloat(uint(127 - level) << 23u);  // / 2^level, exactly
  vec2 t;
  ivec2 index;
  index.x = rasterBefore(from.x, size.x, parts.x, rasterBaseParts.x, inverse.x, t.x);
  index.y = rasterBefore(from.y, size.y, parts.y, rasterBaseParts.y, inverse.y, t.y);
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
