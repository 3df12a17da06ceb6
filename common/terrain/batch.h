// The loop over points around a terrain function. No include guard and no other header: included inside the terrain's namespace or struct,
// after prelude.glsl and the terrain, by the translation units of the built-in terrains and, as text, by those of a person's own file.
// RIDGECAST_STEPS_LEFT, when defined, is a counter that the terrain's loops run down (common/glsl/translate.h); it is wound up for
// every point, and a point at which it ran out gets kOutOfSteps instead of a height.

static constexpr int kBlock = 256;  // points; the scratch arrays stay in the first-level cache
static constexpr int kLanes = 16;   // blocks are padded to whole vectors of the widest variant
static constexpr int kCellBits = 20;
static constexpr uint kInCell = (1u << kCellBits) - 1u;
static constexpr float kStepOfCell = 1.0f / (1 << kCellBits);

// One block, as a structure of arrays. `flatten` inlines the whole terrain function, which is what lets the loop become vector code; a
// function of its own with unaliased pointers and an int for a counter is what g++ 12 needs to see that it may.
__attribute__((flatten, noinline)) void heightsOfBlock(const int* __restrict cellX, const int* __restrict cellZ, const int* __restrict inX,
                                                       const int* __restrict inZ, float* __restrict out, int count, uint seed) {
#ifdef RIDGECAST_STEPS_LEFT
  for (int i = 0; i < count; ++i) {
    RIDGECAST_STEPS_LEFT = kMaxSteps;
    const float h = terrainHeight(ivec2(cellX[i], cellZ[i]),
                                  vec2(static_cast<float>(inX[i]) * kStepOfCell, static_cast<float>(inZ[i]) * kStepOfCell), 0.0f, seed);
    out[i] = RIDGECAST_STEPS_LEFT < 0 ? __builtin_bit_cast(float, kOutOfSteps) : h;
  }
#else
#pragma omp simd
  for (int i = 0; i < count; ++i) {
    // No named vec2 here: it would become an array of structures, and the loop scalar.
    out[i] = terrainHeight(ivec2(cellX[i], cellZ[i]),
                           vec2(static_cast<float>(inX[i]) * kStepOfCell, static_cast<float>(inZ[i]) * kStepOfCell), 0.0f, seed);
  }
#endif
}

void heights(const __INT64_TYPE__* x, const __INT64_TYPE__* z, float* out, __SIZE_TYPE__ count, uint seed) {
  alignas(64) int cellX[kBlock];
  alignas(64) int cellZ[kBlock];
  alignas(64) int inX[kBlock];
  alignas(64) int inZ[kBlock];
  alignas(64) float result[kBlock];
  while (count > 0) {
    const int n = count < kBlock ? static_cast<int>(count) : kBlock;
    const int padded = (n + kLanes - 1) / kLanes * kLanes;
    for (int i = 0; i < n; ++i) {
      cellX[i] = static_cast<int>(x[i] >> kCellBits);
      cellZ[i] = static_cast<int>(z[i] >> kCellBits);
      inX[i] = static_cast<int>(static_cast<uint>(x[i]) & kInCell);
      inZ[i] = static_cast<int>(static_cast<uint>(z[i]) & kInCell);
    }
    for (int i = n; i < padded; ++i) cellX[i] = cellX[0], cellZ[i] = cellZ[0], inX[i] = inX[0], inZ[i] = inZ[0];
    heightsOfBlock(cellX, cellZ, inX, inZ, result, padded, seed);
    __builtin_memcpy(out, result, static_cast<__SIZE_TYPE__>(n) * sizeof(float));
    x += n;
    z += n;
    out += n;
    count -= static_cast<__SIZE_TYPE__>(n);
  }
}

#if defined(RIDGECAST_COLOURS) || defined(RIDGECAST_MATERIALS)
static ivec2 cellOf(__INT64_TYPE__ x, __INT64_TYPE__ z) {
  return ivec2(static_cast<int>(x >> kCellBits), static_cast<int>(z >> kCellBits));
}
static vec2 fractionOf(__INT64_TYPE__ x, __INT64_TYPE__ z) {
  return vec2(static_cast<float>(static_cast<int>(static_cast<uint>(x) & kInCell)) * kStepOfCell,
              static_cast<float>(static_cast<int>(static_cast<uint>(z) & kInCell)) * kStepOfCell);
}
#endif

#ifdef RIDGECAST_COLOURS
// normal and out: three floats a point.
void colours(const __INT64_TYPE__* x, const __INT64_TYPE__* z, const float* height, const float* normal, float footprint, float* out,
             __SIZE_TYPE__ count, uint seed) {
  for (__SIZE_TYPE__ i = 0; i < count; ++i) {
#ifdef RIDGECAST_STEPS_LEFT
    RIDGECAST_STEPS_LEFT = kMaxSteps;
#endif
    const vec3 c = terrainColor(cellOf(x[i], z[i]), fractionOf(x[i], z[i]), height[i],
                                vec3(normal[3 * i], normal[3 * i + 1], normal[3 * i + 2]), footprint, seed);
    out[3 * i] = c.x;
    out[3 * i + 1] = c.y;
    out[3 * i + 2] = c.z;
  }
}
#endif

#ifdef RIDGECAST_MATERIALS
// normal: three floats a point. What is no material's number becomes 255, and what takes too many steps.
void materials(const __INT64_TYPE__* x, const __INT64_TYPE__* z, const float* height, const float* normal, unsigned char* out,
               __SIZE_TYPE__ count, uint seed) {
  for (__SIZE_TYPE__ i = 0; i < count; ++i) {
#ifdef RIDGECAST_STEPS_LEFT
    RIDGECAST_STEPS_LEFT = kMaxSteps;
#endif
    int m = terrainMaterial(cellOf(x[i], z[i]), fractionOf(x[i], z[i]), height[i],
                            vec3(normal[3 * i], normal[3 * i + 1], normal[3 * i + 2]), seed);
#ifdef RIDGECAST_STEPS_LEFT
    if (RIDGECAST_STEPS_LEFT < 0) m = 255;
#endif
    out[i] = static_cast<unsigned char>(m >= 0 && m < 255 ? m : 255);
  }
}
#endif
