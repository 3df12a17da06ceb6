// The part of GLSL that terrain files use, as C++. No include guard: it is included INSIDE a namespace of its own by each translation
// unit that compiles GLSL, so that code compiled for different processors never shares a symbol (the linker would keep one of them, and
// an AVX-512 function might then run on a machine without). Include <cstdint> before. Everything is one lane; the loop around it is
// what the compiler vectorises. Integers wrap (compile with -fwrapv).

using uint = std::uint32_t;

struct vec2 {
  float x, y;
  vec2() = default;
  constexpr vec2(float a, float b) : x(a), y(b) {}
};
struct vec3 {
  float x, y, z;
  vec3() = default;
  constexpr vec3(float a, float b, float c) : x(a), y(b), z(c) {}
};
struct ivec2 {
  int x, y;
  ivec2() = default;
  constexpr ivec2(int a, int b) : x(a), y(b) {}
};
struct uvec2 {
  uint x, y;
  uvec2() = default;
  constexpr uvec2(uint a, uint b) : x(a), y(b) {}
};

constexpr vec2 operator+(vec2 a, vec2 b) { return {a.x + b.x, a.y + b.y}; }
constexpr vec2 operator-(vec2 a, vec2 b) { return {a.x - b.x, a.y - b.y}; }
constexpr vec2 operator*(vec2 a, vec2 b) { return {a.x * b.x, a.y * b.y}; }
constexpr vec2 operator/(vec2 a, vec2 b) { return {a.x / b.x, a.y / b.y}; }
constexpr vec2 operator*(vec2 a, float s) { return {a.x * s, a.y * s}; }
constexpr vec2 operator*(float s, vec2 a) { return {s * a.x, s * a.y}; }
constexpr vec2 operator/(vec2 a, float s) { return {a.x / s, a.y / s}; }
constexpr vec2 operator-(vec2 a) { return {-a.x, -a.y}; }
constexpr vec2& operator+=(vec2& a, vec2 b) { return a = a + b; }
constexpr vec2& operator-=(vec2& a, vec2 b) { return a = a - b; }
constexpr vec2& operator*=(vec2& a, float s) { return a = a * s; }

constexpr vec3 operator+(vec3 a, vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr vec3 operator-(vec3 a, vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
constexpr vec3 operator*(vec3 a, vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
constexpr vec3 operator*(vec3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
constexpr vec3 operator*(float s, vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
constexpr vec3 operator/(vec3 a, float s) { return {a.x / s, a.y / s, a.z / s}; }
constexpr vec3& operator+=(vec3& a, vec3 b) { return a = a + b; }
constexpr vec3& operator*=(vec3& a, float s) { return a = a * s; }

constexpr ivec2 operator+(ivec2 a, ivec2 b) { return {a.x + b.x, a.y + b.y}; }
constexpr uvec2 operator+(uvec2 a, uvec2 b) { return {a.x + b.x, a.y + b.y}; }

#ifdef __SSE4_1__
inline float floor(float v) { return __builtin_floorf(v); }
#else
// No rounding instruction here, and a call would stop the vectoriser. For |v| < 2^31, which all arguments are.
inline float floor(float v) {
  const float whole = static_cast<float>(static_cast<int>(v));
  return whole - (whole > v ? 1.0f : 0.0f);
}
#endif
inline float sqrt(float v) { return __builtin_sqrtf(v); }
inline uint floatBitsToUint(float v) { return __builtin_bit_cast(uint, v); }
inline float uintBitsToFloat(uint v) { return __builtin_bit_cast(float, v); }
inline float abs(float v) { return __builtin_fabsf(v); }
constexpr float min(float a, float b) { return b < a ? b : a; }
constexpr float max(float a, float b) { return a < b ? b : a; }
constexpr float clamp(float v, float low, float high) { return min(max(v, low), high); }
constexpr float mix(float a, float b, float t) { return a * (1.0f - t) + b * t; }
constexpr vec3 mix(vec3 a, vec3 b, float t) { return a * (1.0f - t) + b * t; }
constexpr float smoothstep(float low, float high, float v) {
  const float t = clamp((v - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}
constexpr float dot(vec2 a, vec2 b) { return a.x * b.x + a.y * b.y; }
constexpr float dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
