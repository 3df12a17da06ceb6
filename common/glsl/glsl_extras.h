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
  constexpr bool operator==(const Array__&) const = default;
};

// Vectors of C++ and GLSL that glsl_as_cpp.h has no need of.
RIDGECAST_SCALAR_FIRST(operator&, RIDGECAST_AND)
RIDGECAST_SCALAR_FIRST(operator|, RIDGECAST_OR)
RIDGECAST_SCALAR_FIRST(operator^, RIDGECAST_XOR)
#define RIDGECAST_VECTOR(Vector)                             \
  template <class T>                                         \
  constexpr Vector<T> operator+(Vector<T> v) {               \
    return v;                                                \
  }                                                          \
  template <class T>                                         \
  constexpr Vector<T>& operator++(Vector<T>& v) {            \
    return v += T(1);                                        \
  }                                                          \
  template <class T>                                         \
  constexpr Vector<T>& operator--(Vector<T>& v) {            \
    return v -= T(1);                                        \
  }                                                          \
  template <class T>                                         \
  constexpr Vector<T> operator++(Vector<T>& v, int) {        \
    const Vector<T> before = v;                              \
    v += T(1);                                               \
    return before;                                           \
  }                                                          \
  template <class T>                                         \
  constexpr Vector<T> operator--(Vector<T>& v, int) {        \
    const Vector<T> before = v;                              \
    v -= T(1);                                               \
    return before;                                           \
  }                                                          \
  template <class T>                                         \
  constexpr Vector<T>& operator/=(Vector<T>& v, Same<T> b) { \
    return v = v / b;                                        \
  }                                                          \
  template <class T, class U>                                \
  constexpr Vector<T> operator<<(Vector<T> a, Vector<U> b) { \
    return a << Vector<T>(b);                                \
  }                                                          \
  template <class T, class U>                                \
  constexpr Vector<T> operator>>(Vector<T> a, Vector<U> b) { \
    return a >> Vector<T>(b);                                \
  }
RIDGECAST_VECTOR(Vector2)
RIDGECAST_VECTOR(Vector3)
RIDGECAST_VECTOR(Vector4)
#undef RIDGECAST_VECTOR
template <class T>
constexpr Vector2<T> operator~(Vector2<T> v) {
  return {~v.x, ~v.y};
}
template <class T>
constexpr Vector3<T> operator~(Vector3<T> v) {
  return {~v.x, ~v.y, ~v.z};
}
template <class T>
constexpr Vector4<T> operator~(Vector4<T> v) {
  return {~v.x, ~v.y, ~v.z, ~v.w};
}

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
// Of a sum that a float could not hold: places in metres are far out. Beyond 10^15 turns it is some number in [-1, 1].
inline float sine(double v) {
  constexpr double kWhole = 6755399441055744.0;  // 3 * 2^51: adding it rounds to the nearest whole number, in vector code, too
  const double turns = (v * 0.31830988618379067 + kWhole) - kWhole;
  const double odd = turns - 2.0 * ((turns * 0.5 + kWhole) - kWhole);
  const float r = clamp(float(v - turns * 3.1415926535897931), -1.5707964f, 1.5707964f), s = r * r;
  const float p = r + r * s * (-0.16666667f + s * (0.0083333310f + s * (-0.00019840874f + s * 2.7525562e-06f)));
  return clamp(odd != 0.0 ? -p : p, -1.0f, 1.0f);
}
inline float sin(float v) { return sine(double(v)); }
inline float cos(float v) { return sine(double(v) + 1.5707963267948966); }
inline float tan(float v) {
  const float c = cos(v);
  return sin(v) / (abs(c) < 1e-7f ? 1e-7f : c);
}
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
inline float sinh(float v) {
  const float e = exp(v);
  return abs(v) < 0.5f ? v + v * v * v * (0.16666667f + v * v * (0.0083333333f + v * v * 0.00019841270f)) : 0.5f * (e - 1.0f / e);
}
inline float cosh(float v) {
  const float e = exp(v);
  return 0.5f * (e + 1.0f / e);
}
inline float asinh(float v) { return sign(v) * log(abs(v) + sqrt(v * v + 1.0f)); }
inline float acosh(float v) { return log(v + sqrt(v * v - 1.0f)); }
inline float atanh(float v) { return 0.5f * log((1.0f + v) / (1.0f - v)); }
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
RIDGECAST_EACH(asin)
RIDGECAST_EACH(acos)
RIDGECAST_EACH(atan)
RIDGECAST_EACH(sinh)
RIDGECAST_EACH(cosh)
RIDGECAST_EACH(tanh)
RIDGECAST_EACH(asinh)
RIDGECAST_EACH(acosh)
RIDGECAST_EACH(atanh)
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
RIDGECAST_EACH_TWO(atan)
#undef RIDGECAST_EACH_TWO
inline vec2 step(float e, vec2 v) { return step(vec2(e), v); }
inline vec3 step(float e, vec3 v) { return step(vec3(e), v); }
inline vec4 step(float e, vec4 v) { return step(vec4(e), v); }
#define RIDGECAST_EACH_THREE(name)                                                                                     \
  inline vec2 name(vec2 a, vec2 b, vec2 c) { return {name(a.x, b.x, c.x), name(a.y, b.y, c.y)}; }                      \
  inline vec3 name(vec3 a, vec3 b, vec3 c) { return {name(a.x, b.x, c.x), name(a.y, b.y, c.y), name(a.z, b.z, c.z)}; } \
  inline vec4 name(vec4 a, vec4 b, vec4 c) { return {name(a.x, b.x, c.x), name(a.y, b.y, c.y), name(a.z, b.z, c.z), name(a.w, b.w, c.w)}; }
RIDGECAST_EACH_THREE(clamp)
RIDGECAST_EACH_THREE(mix)
RIDGECAST_EACH_THREE(smoothstep)
#undef RIDGECAST_EACH_THREE
inline vec2 clamp(vec2 v, float a, float b) { return clamp(v, vec2(a), vec2(b)); }
inline vec3 clamp(vec3 v, float a, float b) { return clamp(v, vec3(a), vec3(b)); }
inline vec4 clamp(vec4 v, float a, float b) { return clamp(v, vec4(a), vec4(b)); }
inline vec2 smoothstep(float a, float b, vec2 v) { return smoothstep(vec2(a), vec2(b), v); }
inline vec3 smoothstep(float a, float b, vec3 v) { return smoothstep(vec3(a), vec3(b), v); }
inline vec4 smoothstep(float a, float b, vec4 v) { return smoothstep(vec4(a), vec4(b), v); }
inline vec4 mix(vec4 a, vec4 b, float t) { return a * (1.0f - t) + b * t; }
constexpr float mix(float a, float b, bool t) { return t ? b : a; }
constexpr vec2 mix(vec2 a, vec2 b, bvec2 t) { return {t.x ? b.x : a.x, t.y ? b.y : a.y}; }
constexpr vec3 mix(vec3 a, vec3 b, bvec3 t) { return {t.x ? b.x : a.x, t.y ? b.y : a.y, t.z ? b.z : a.z}; }
constexpr vec4 mix(vec4 a, vec4 b, bvec4 t) { return {t.x ? b.x : a.x, t.y ? b.y : a.y, t.z ? b.z : a.z, t.w ? b.w : a.w}; }

// Of whole numbers.
#define RIDGECAST_WHOLE(vec2, vec3, vec4, number)                                                          \
  inline vec2 min(vec2 a, vec2 b) { return {min(a.x, b.x), min(a.y, b.y)}; }                               \
  inline vec3 min(vec3 a, vec3 b) { return {min(a.x, b.x), min(a.y, b.y), min(a.z, b.z)}; }                \
  inline vec4 min(vec4 a, vec4 b) { return {min(a.x, b.x), min(a.y, b.y), min(a.z, b.z), min(a.w, b.w)}; } \
  inline vec2 max(vec2 a, vec2 b) { return {max(a.x, b.x), max(a.y, b.y)}; }                               \
  inline vec3 max(vec3 a, vec3 b) { return {max(a.x, b.x), max(a.y, b.y), max(a.z, b.z)}; }                \
  inline vec4 max(vec4 a, vec4 b) { return {max(a.x, b.x), max(a.y, b.y), max(a.z, b.z), max(a.w, b.w)}; } \
  inline vec2 min(vec2 a, number b) { return min(a, vec2(b)); }                                            \
  inline vec3 min(vec3 a, number b) { return min(a, vec3(b)); }                                            \
  inline vec4 min(vec4 a, number b) { return min(a, vec4(b)); }                                            \
  inline vec2 max(vec2 a, number b) { return max(a, vec2(b)); }                                            \
  inline vec3 max(vec3 a, number b) { return max(a, vec3(b)); }                                            \
  inline vec4 max(vec4 a, number b) { return max(a, vec4(b)); }                                            \
  inline vec2 clamp(vec2 v, vec2 a, vec2 b) { return min(max(v, a), b); }                                  \
  inline vec3 clamp(vec3 v, vec3 a, vec3 b) { return min(max(v, a), b); }                                  \
  inline vec4 clamp(vec4 v, vec4 a, vec4 b) { return min(max(v, a), b); }                                  \
  inline vec2 clamp(vec2 v, number a, number b) { return min(max(v, a), b); }                              \
  inline vec3 clamp(vec3 v, number a, number b) { return min(max(v, a), b); }                              \
  inline vec4 clamp(vec4 v, number a, number b) { return min(max(v, a), b); }
RIDGECAST_WHOLE(ivec2, ivec3, ivec4, int)
RIDGECAST_WHOLE(uvec2, uvec3, uvec4, uint)
#undef RIDGECAST_WHOLE
inline ivec2 abs(ivec2 v) { return {abs(v.x), abs(v.y)}; }
inline ivec3 abs(ivec3 v) { return {abs(v.x), abs(v.y), abs(v.z)}; }
inline ivec4 abs(ivec4 v) { return {abs(v.x), abs(v.y), abs(v.z), abs(v.w)}; }
inline ivec2 sign(ivec2 v) { return {sign(v.x), sign(v.y)}; }
inline ivec3 sign(ivec3 v) { return {sign(v.x), sign(v.y), sign(v.z)}; }
inline ivec4 sign(ivec4 v) { return {sign(v.x), sign(v.y), sign(v.z), sign(v.w)}; }
#define RIDGECAST_BITS(name, From, To)                                                   \
  inline Vector2<To> name(Vector2<From> v) { return {name(v.x), name(v.y)}; }            \
  inline Vector3<To> name(Vector3<From> v) { return {name(v.x), name(v.y), name(v.z)}; } \
  inline Vector4<To> name(Vector4<From> v) { return {name(v.x), name(v.y), name(v.z), name(v.w)}; }
RIDGECAST_BITS(floatBitsToUint, float, uint)
RIDGECAST_BITS(floatBitsToInt, float, int)
RIDGECAST_BITS(uintBitsToFloat, uint, float)
RIDGECAST_BITS(intBitsToFloat, int, float)
inline bool isnan(float v) { return v != v; }
inline bool isinf(float v) { return abs(v) > 3.4028234e38f; }
RIDGECAST_BITS(isnan, float, bool)
RIDGECAST_BITS(isinf, float, bool)
#undef RIDGECAST_BITS

inline float length(float v) { return abs(v); }
inline float length(vec2 v) { return sqrt(dot(v, v)); }
inline float length(vec3 v) { return sqrt(dot(v, v)); }
inline float length(vec4 v) { return sqrt(dot(v, v)); }
inline float dot(float a, float b) { return a * b; }
inline float normalize(float v) { return sign(v); }
inline vec2 normalize(vec2 v) { return v * inversesqrt(dot(v, v)); }
inline vec3 normalize(vec3 v) { return v * inversesqrt(dot(v, v)); }
inline vec4 normalize(vec4 v) { return v * inversesqrt(dot(v, v)); }
#define RIDGECAST_GEOMETRY(vec)                                                             \
  inline float distance(vec a, vec b) { return length(a - b); }                             \
  inline vec faceforward(vec n, vec v, vec other) { return dot(other, v) < 0.0f ? n : -n; } \
  inline vec reflect(vec v, vec n) { return v - n * (2.0f * dot(n, v)); }                   \
  inline vec refract(vec v, vec n, float eta) {                                             \
    const float d = dot(n, v), k = 1.0f - eta * eta * (1.0f - d * d);                       \
    return k < 0.0f ? vec(0.0f) : v * eta - n * (eta * d + sqrt(max(k, 0.0f)));             \
  }                                                                                         \
  inline vec modf(vec v, vec& whole) {                                                      \
    whole = trunc(v);                                                                       \
    return v - whole;                                                                       \
  }
RIDGECAST_GEOMETRY(float)
RIDGECAST_GEOMETRY(vec2)
RIDGECAST_GEOMETRY(vec3)
RIDGECAST_GEOMETRY(vec4)
#undef RIDGECAST_GEOMETRY
#define RIDGECAST_COMPARE(name, op)                          \
  template <class T>                                         \
  constexpr bvec2 name(Vector2<T> a, Vector2<T> b) {         \
    return {a.x op b.x, a.y op b.y};                         \
  }                                                          \
  template <class T>                                         \
  constexpr bvec3 name(Vector3<T> a, Vector3<T> b) {         \
    return {a.x op b.x, a.y op b.y, a.z op b.z};             \
  }                                                          \
  template <class T>                                         \
  constexpr bvec4 name(Vector4<T> a, Vector4<T> b) {         \
    return {a.x op b.x, a.y op b.y, a.z op b.z, a.w op b.w}; \
  }
RIDGECAST_COMPARE(lessThan, <)
RIDGECAST_COMPARE(lessThanEqual, <=)
RIDGECAST_COMPARE(greaterThan, >)
RIDGECAST_COMPARE(greaterThanEqual, >=)
RIDGECAST_COMPARE(equal, ==)
RIDGECAST_COMPARE(notEqual, !=)
#undef RIDGECAST_COMPARE
constexpr bool any(bvec2 v) { return v.x || v.y; }
constexpr bool any(bvec3 v) { return v.x || v.y || v.z; }
constexpr bool any(bvec4 v) { return v.x || v.y || v.z || v.w; }
constexpr bool all(bvec2 v) { return v.x && v.y; }
constexpr bool all(bvec3 v) { return v.x && v.y && v.z; }
constexpr bool all(bvec4 v) { return v.x && v.y && v.z && v.w; }
constexpr bvec2 claimed__not(bvec2 v) { return {!v.x, !v.y}; }
constexpr bvec3 claimed__not(bvec3 v) { return {!v.x, !v.y, !v.z}; }
constexpr bvec4 claimed__not(bvec4 v) { return {!v.x, !v.y, !v.z, !v.w}; }
