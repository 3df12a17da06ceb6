// What a user's terrain file may use beyond glsl_as_cpp.h; included as text after it. Names that end in __ are for the translation: GLSL
// reserves them.

// a / over__ / b and a /= over__ = b: division that never traps (divided, remainderOf). C++ groups them like a / b.
struct Over__ {};
struct Rem__ {};
template <class A>
struct DividedBy__ {
  A a;
};
template <class A>
struct RemainderBy__ {
  A a;
};
template <class B>
struct Divisor__ {
  B b;
};
template <class B>
struct Modulus__ {
  B b;
};
struct OverAssigner__ {
  template <class B>
  constexpr Divisor__<B> operator=(B b) const {
    return {b};
  }
};
struct RemAssigner__ {
  template <class B>
  constexpr Modulus__<B> operator=(B b) const {
    return {b};
  }
};
constexpr Over__ over__{};
constexpr Rem__ rem__{};
constexpr OverAssigner__ overAssigned__{};
constexpr RemAssigner__ remAssigned__{};
template <class A>
constexpr DividedBy__<A> operator/(A a, Over__) {
  return {a};
}
template <class A, class B>
constexpr auto operator/(DividedBy__<A> a, B b) {
  return divided(a.a, b);
}
template <class A>
constexpr RemainderBy__<A> operator/(A a, Rem__) {
  return {a};
}
template <class A, class B>
constexpr auto operator/(RemainderBy__<A> a, B b) {
  return remainderOf(a.a, b);
}
template <class A, class B>
constexpr A& operator/=(A& a, Divisor__<B> d) {
  return a = divided(a, d.b);
}
template <class A, class B>
constexpr A& operator/=(A& a, Modulus__<B> d) {
  return a = remainderOf(a, d.b);
}

// An array with safe access: an index out of range means the nearest one in range.
template <class T, int N>
struct Array__ {
  static_assert(N >= 1 && sizeof(T) * N <= 16384, "an array may have 16,384 bytes");
  T items[N];
  constexpr T& operator[](int i) { return items[i < 0 ? 0 : i >= N ? N - 1 : i]; }
  constexpr const T& operator[](int i) const { return items[i < 0 ? 0 : i >= N ? N - 1 : i]; }
  constexpr int length() const { return N; }
};

struct mat2 {
  vec2 column0, column1;
  mat2() = default;
  constexpr explicit mat2(float d) : column0(d, 0.0f), column1(0.0f, d) {}
  constexpr mat2(float a, float b, float c, float d) : column0(a, b), column1(c, d) {}
  constexpr mat2(vec2 a, vec2 b) : column0(a), column1(b) {}
  constexpr vec2& operator[](int i) { return i <= 0 ? column0 : column1; }
  constexpr const vec2& operator[](int i) const { return i <= 0 ? column0 : column1; }
};
struct mat3 {
  vec3 column0, column1, column2;
  mat3() = default;
  constexpr explicit mat3(float d) : column0(d, 0.0f, 0.0f), column1(0.0f, d, 0.0f), column2(0.0f, 0.0f, d) {}
  constexpr mat3(float a, float b, float c, float d, float e, float f, float g, float h, float i)
      : column0(a, b, c), column1(d, e, f), column2(g, h, i) {}
  constexpr mat3(vec3 a, vec3 b, vec3 c) : column0(a), column1(b), column2(c) {}
  constexpr vec3& operator[](int i) { return i <= 0 ? column0 : i == 1 ? column1 : column2; }
  constexpr const vec3& operator[](int i) const { return i <= 0 ? column0 : i == 1 ? column1 : column2; }
};
constexpr vec2 operator*(mat2 m, vec2 v) { return m.column0 * v.x + m.column1 * v.y; }
constexpr vec2 operator*(vec2 v, mat2 m) { return {dot(v, m.column0), dot(v, m.column1)}; }
constexpr mat2 operator*(mat2 a, mat2 b) { return {a * b.column0, a * b.column1}; }
constexpr mat2 operator*(mat2 m, float s) { return {m.column0 * s, m.column1 * s}; }
constexpr mat2 operator*(float s, mat2 m) { return m * s; }
constexpr mat2& operator*=(mat2& a, mat2 b) { return a = a * b; }
constexpr vec2& operator*=(vec2& v, mat2 m) { return v = v * m; }
constexpr vec3 operator*(mat3 m, vec3 v) { return m.column0 * v.x + m.column1 * v.y + m.column2 * v.z; }
constexpr vec3 operator*(vec3 v, mat3 m) { return {dot(v, m.column0), dot(v, m.column1), dot(v, m.column2)}; }
constexpr mat3 operator*(mat3 a, mat3 b) { return {a * b.column0, a * b.column1, a * b.column2}; }
constexpr vec3& operator*=(vec3& v, mat3 m) { return v = v * m; }

// Functions that graphics cards round differently. Here they are polynomials, so that loops over them become vector code: within a few 1e-7
// of the true value for ordinary arguments, so pictures differ by millimetres.
inline float ceil(float v) { return -floor(-v); }
inline float trunc(float v) { return v < 0.0f ? -floor(-v) : floor(v); }
inline float round(float v) { return floor(v + 0.5f); }
inline float roundEven(float v) {
  const float r = floor(v + 0.5f);
  return r - v == 0.5f && floor(r * 0.5f) * 2.0f != r ? r - 1.0f : r;
}
inline float fract(float v) { return v - floor(v); }
inline float mod(float a, float b) { return a - b * floor(a / b); }
constexpr float step(float edge, float v) { return v < edge ? 0.0f : 1.0f; }
constexpr float sign(float v) { return v > 0.0f ? 1.0f : v < 0.0f ? -1.0f : 0.0f; }
constexpr int sign(int v) { return v > 0 ? 1 : v < 0 ? -1 : 0; }
inline float inversesqrt(float v) { return 1.0f / sqrt(v); }
inline float radians(float v) { return v * 0.017453292f; }
inline float degrees(float v) { return v * 57.29578f; }
inline float sin(float v) {
  const float turns = floor(v * 0.31830989f + 0.5f);
  const float r = (v - turns * 3.140625f) - turns * 0.00096765359f;
  const float s = r * r;
  const float p = r + r * s * (-0.16666667f + s * (0.0083333310f + s * (-0.00019840874f + s * 2.7525562e-06f)));
  return floor(turns * 0.5f) * 2.0f == turns ? p : -p;
}
inline float cos(float v) { return sin(v + 1.5707964f); }
inline float tan(float v) { return sin(v) / cos(v); }
inline float exp2(float v) {
  const float c = clamp(v, -126.0f, 127.99999f);
  const float whole = floor(c), f = c - whole;
  const float p =
      1.0f + f * (0.69314718f + f * (0.24022651f + f * (0.05550357f + f * (0.0096139924f + f * (0.0013264815f + f * 0.00015469732f)))));
  const float r = p * uintBitsToFloat(uint(int(whole) + 127) << 23);
  return v != v ? v : v < -126.0f ? 0.0f : v >= 128.0f ? uintBitsToFloat(0x7f800000u) : r;
}
inline float log2(float v) {
  const uint bits = floatBitsToUint(v) - 0x3f3504f3u;  // so that the mantissa lies around 1
  const float exponent = float(int(bits) >> 23);
  const float m = uintBitsToFloat((bits & 0x007fffffu) + 0x3f3504f3u);
  const float t = (m - 1.0f) / (m + 1.0f), s = t * t;
  const float r = exponent + t * (2.8853901f + s * (0.96179669f + s * (0.57708016f + s * 0.43255f)));
  return v > 0.0f ? r : v == 0.0f ? uintBitsToFloat(0xff800000u) : uintBitsToFloat(0x7fc00000u);
}
inline float exp(float v) { return exp2(v * 1.4426950f); }
inline float log(float v) { return log2(v) * 0.69314718f; }
inline float pow(float v, float e) { return exp2(log2(v) * e); }
inline float atan(float v) {
  const float a = abs(v), r = a > 1.0f ? 1.0f / a : a, s = r * r;
  const float p = r * (0.99997726f + s * (-0.33262347f + s * (0.19354346f + s * (-0.11643287f + s * (0.05265332f - s * 0.01172120f)))));
  const float q = a > 1.0f ? 1.5707963f - p : p;
  return v < 0.0f ? -q : q;
}
inline float atan(float y, float x) {
  const float q = x == 0.0f ? 1.5707963f * sign(y) : atan(y / x);
  return x < 0.0f ? q + (y < 0.0f ? -3.1415927f : 3.1415927f) : q;
}
inline float acos(float v) { return atan(sqrt(max(1.0f - v * v, 0.0f)), v); }
inline float asin(float v) { return atan(v, sqrt(max(1.0f - v * v, 0.0f))); }
inline float tanh(float v) {
  const float e = exp2(clamp(v, -20.0f, 20.0f) * 2.8853901f);
  return (e - 1.0f) / (e + 1.0f);
}

// The same, component by component.
#define RIDGECAST_EACH(name)                                             \
  inline vec2 name(vec2 v) { return {name(v.x), name(v.y)}; }            \
  inline vec3 name(vec3 v) { return {name(v.x), name(v.y), name(v.z)}; } \
  inline vec4 name(vec4 v) { return {name(v.x), name(v.y), name(v.z), name(v.w)}; }
RIDGECAST_EACH(floor)
RIDGECAST_EACH(ceil)
RIDGECAST_EACH(trunc)
RIDGECAST_EACH(round)
RIDGECAST_EACH(roundEven)
RIDGECAST_EACH(fract)
RIDGECAST_EACH(abs)
RIDGECAST_EACH(sign)
RIDGECAST_EACH(sqrt)
RIDGECAST_EACH(inversesqrt)
RIDGECAST_EACH(radians)
RIDGECAST_EACH(degrees)
RIDGECAST_EACH(sin)
RIDGECAST_EACH(cos)
RIDGECAST_EACH(tan)
RIDGECAST_EACH(exp)
RIDGECAST_EACH(exp2)
RIDGECAST_EACH(log)
RIDGECAST_EACH(log2)
#undef RIDGECAST_EACH
#define RIDGECAST_EACH_TWO(name)                                                                                \
  inline vec2 name(vec2 a, vec2 b) { return {name(a.x, b.x), name(a.y, b.y)}; }                                 \
  inline vec3 name(vec3 a, vec3 b) { return {name(a.x, b.x), name(a.y, b.y), name(a.z, b.z)}; }                 \
  inline vec4 name(vec4 a, vec4 b) { return {name(a.x, b.x), name(a.y, b.y), name(a.z, b.z), name(a.w, b.w)}; } \
  inline vec2 name(vec2 a, float b) { return {name(a.x, b), name(a.y, b)}; }                                    \
  inline vec3 name(vec3 a, float b) { return {name(a.x, b), name(a.y, b), name(a.z, b)}; }                      \
  inline vec4 name(vec4 a, float b) { return {name(a.x, b), name(a.y, b), name(a.z, b), name(a.w, b)}; }
RIDGECAST_EACH_TWO(min)
RIDGECAST_EACH_TWO(max)
RIDGECAST_EACH_TWO(mod)
RIDGECAST_EACH_TWO(pow)
RIDGECAST_EACH_TWO(step)
#undef RIDGECAST_EACH_TWO
inline vec2 step(float e, vec2 v) { return {step(e, v.x), step(e, v.y)}; }
inline vec3 step(float e, vec3 v) { return {step(e, v.x), step(e, v.y), step(e, v.z)}; }
inline ivec2 min(ivec2 a, ivec2 b) { return {min(a.x, b.x), min(a.y, b.y)}; }
inline ivec2 max(ivec2 a, ivec2 b) { return {max(a.x, b.x), max(a.y, b.y)}; }
inline ivec2 abs(ivec2 v) { return {abs(v.x), abs(v.y)}; }
inline vec2 clamp(vec2 v, float a, float b) { return {clamp(v.x, a, b), clamp(v.y, a, b)}; }
inline vec3 clamp(vec3 v, float a, float b) { return {clamp(v.x, a, b), clamp(v.y, a, b), clamp(v.z, a, b)}; }
inline vec2 clamp(vec2 v, vec2 a, vec2 b) { return {clamp(v.x, a.x, b.x), clamp(v.y, a.y, b.y)}; }
inline vec3 clamp(vec3 v, vec3 a, vec3 b) { return {clamp(v.x, a.x, b.x), clamp(v.y, a.y, b.y), clamp(v.z, a.z, b.z)}; }
inline vec2 mix(vec2 a, vec2 b, vec2 t) { return {mix(a.x, b.x, t.x), mix(a.y, b.y, t.y)}; }
inline vec3 mix(vec3 a, vec3 b, vec3 t) { return {mix(a.x, b.x, t.x), mix(a.y, b.y, t.y), mix(a.z, b.z, t.z)}; }
inline vec4 mix(vec4 a, vec4 b, float t) { return a * (1.0f - t) + b * t; }
constexpr float mix(float a, float b, bool t) { return t ? b : a; }
inline vec2 smoothstep(float a, float b, vec2 v) { return {smoothstep(a, b, v.x), smoothstep(a, b, v.y)}; }
inline vec2 smoothstep(vec2 a, vec2 b, vec2 v) { return {smoothstep(a.x, b.x, v.x), smoothstep(a.y, b.y, v.y)}; }
inline vec3 smoothstep(float a, float b, vec3 v) { return {smoothstep(a, b, v.x), smoothstep(a, b, v.y), smoothstep(a, b, v.z)}; }
inline float length(float v) { return abs(v); }
inline float length(vec2 v) { return sqrt(dot(v, v)); }
inline float length(vec3 v) { return sqrt(dot(v, v)); }
inline float length(vec4 v) { return sqrt(dot(v, v)); }
inline float distance(vec2 a, vec2 b) { return length(a - b); }
inline float distance(vec3 a, vec3 b) { return length(a - b); }
inline vec2 normalize(vec2 v) { return v * inversesqrt(dot(v, v)); }
inline vec3 normalize(vec3 v) { return v * inversesqrt(dot(v, v)); }
inline vec3 cross(vec3 a, vec3 b) { return {a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y}; }
inline vec2 reflect(vec2 v, vec2 n) { return v - n * (2.0f * dot(n, v)); }
inline vec3 reflect(vec3 v, vec3 n) { return v - n * (2.0f * dot(n, v)); }
inline bool isnan(float v) { return v != v; }
inline bool isinf(float v) { return abs(v) > 3.4e38f; }
inline bvec2 lessThan(vec2 a, vec2 b) { return {a.x < b.x, a.y < b.y}; }
inline bvec2 greaterThan(vec2 a, vec2 b) { return {a.x > b.x, a.y > b.y}; }
inline bvec3 lessThan(vec3 a, vec3 b) { return {a.x < b.x, a.y < b.y, a.z < b.z}; }
inline bvec3 greaterThan(vec3 a, vec3 b) { return {a.x > b.x, a.y > b.y, a.z > b.z}; }
constexpr bool any(bvec2 v) { return v.x || v.y; }
constexpr bool any(bvec3 v) { return v.x || v.y || v.z; }
constexpr bool all(bvec2 v) { return v.x && v.y; }
constexpr bool all(bvec3 v) { return v.x && v.y && v.z; }
