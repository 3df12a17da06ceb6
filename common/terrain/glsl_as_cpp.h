// GLSL as C++: the types, operators and functions that heights are made of. No include guard and no other header: it is included INSIDE
// a namespace of its own by each translation unit that compiles GLSL, so that code compiled for different processors never shares a
// symbol (the linker would keep one of them, and an AVX-512 function might then run on a machine without). Everything is one lane; the
// loop around it is what the compiler vectorises. Integers wrap (compile with -fwrapv). Nothing here can trap or reach outside its
// operands, whatever a person's file does with it: see over, rem, Array and the index operators.
// Raw GLSL compiles only where it keeps to what C++ reads alike (README.md); common/glsl rewrites the rest: swizzles, arrays,
// division, `out`.

using uint = __UINT32_TYPE__;

template <class T>
struct SameType {
  using Type = T;
};
template <class T>
using Same = typename SameType<T>::Type;  // keeps a parameter out of deduction: vec2 * 2.0f

template <class T>
struct Vector2;
template <class T>
struct Vector3;
template <class T>
struct Vector4;

// Component k; past the end is the last, so that a wrong index reads what is there.
template <int K, class V>
constexpr auto& component(V& v) {
  if constexpr (K == 0)
    return v.x;
  else if constexpr (K == 1)
    return v.y;
  else if constexpr (K == 2)
    return v.z;
  else
    return v.w;
}
template <class T, int... K, class V>
constexpr auto swizzled(V v) {
  if constexpr (sizeof...(K) == 2)
    return Vector2<T>(component<K>(v)...);
  else if constexpr (sizeof...(K) == 3)
    return Vector3<T>(component<K>(v)...);
  else
    return Vector4<T>(component<K>(v)...);
}

// Several components of a vector, assigned to: p.xz *= m.
template <class V, int... K>
struct Assigned {
  V& of;
  constexpr auto value() const { return swizzled<decltype(of.x), K...>(of); }
  template <class Value>
  constexpr Value operator=(Value v) const {
    static_assert(__is_same(Value, decltype(swizzled<decltype(of.x), K...>(of))), "what is assigned has other components");
    constexpr int at[] = {K...};
    component<at[0]>(of) = v.x;
    component<at[1]>(of) = v.y;
    if constexpr (sizeof...(K) > 2) component<at[2]>(of) = v.z;
    if constexpr (sizeof...(K) > 3) component<at[3]>(of) = v.w;
    return v;
  }
#define RIDGECAST_ASSIGNED(op)               \
  template <class B>                         \
  constexpr auto operator op##=(B b) const { \
    auto v = value();                        \
    v op## = b;                              \
    return *this = v;                        \
  }
  RIDGECAST_ASSIGNED(+)
  RIDGECAST_ASSIGNED(-)
  RIDGECAST_ASSIGNED(*)
  RIDGECAST_ASSIGNED(/)
  RIDGECAST_ASSIGNED(&)
  RIDGECAST_ASSIGNED(|)
  RIDGECAST_ASSIGNED(^)
  RIDGECAST_ASSIGNED(<<)
  RIDGECAST_ASSIGNED(>>)
#undef RIDGECAST_ASSIGNED
  constexpr auto operator++() const { return *this += decltype(of.x)(1); }
  constexpr auto operator--() const { return *this -= decltype(of.x)(1); }
  constexpr auto operator++(int) const {
    const auto before = value();
    ++*this;
    return before;
  }
  constexpr auto operator--(int) const {
    const auto before = value();
    --*this;
    return before;
  }
  constexpr auto& operator[](int i) const {
    constexpr int at[] = {K...}, last = sizeof...(K) - 1;
    return of[at[i <= 0 ? 0 : i >= last ? last : i]];
  }
};

// The same as an argument that a function writes, copied back at the end of the statement.
template <class V, int... K>
struct Handed {
  using Value = decltype(swizzled<decltype(V::x), K...>(V()));
  V& of;
  Value value;
  constexpr explicit Handed(V& v) : of(v), value(swizzled<decltype(V::x), K...>(v)) {}
  constexpr ~Handed() { Assigned<V, K...>{of} = value; }
  constexpr operator Value&() { return value; }
};

// The components of numbers and vectors one after the other, which constructors take in any mixture.
template <class T>
struct Components {
  T at[16];
  int count = 0;
  template <class U>
  constexpr void put(U v) {
    if (count < 16) at[count++] = T(v);
  }
  template <class U>
  constexpr void put(Vector2<U> v) {
    put(v.x), put(v.y);
  }
  template <class U>
  constexpr void put(Vector3<U> v) {
    put(v.x), put(v.y), put(v.z);
  }
  template <class U>
  constexpr void put(Vector4<U> v) {
    put(v.x), put(v.y), put(v.z), put(v.w);
  }
  template <class... A>
  constexpr explicit Components(const A&... a) : at{} {
    (put(a), ...);
  }
};

// Of all vectors: components of it, to read, to assign to, and to hand to an `inout` of a function; and its first as a number.
#define RIDGECAST_PARTS(Vector)                                  \
  template <int... K>                                            \
  constexpr auto swizzle() const {                               \
    return swizzled<T, K...>(*this);                             \
  }                                                              \
  template <int... K>                                            \
  constexpr auto assigned()& {                                   \
    return Assigned<Vector, K...>{*this};                        \
  }                                                              \
  template <int... K>                                            \
  constexpr auto handed()& {                                     \
    return Handed<Vector, K...>(*this);                          \
  }                                                              \
  constexpr explicit operator bool() const { return bool(x); }   \
  constexpr explicit operator float() const { return float(x); } \
  constexpr explicit operator int() const { return int(x); }     \
  constexpr explicit operator uint() const { return uint(x); }

template <class T>
struct Vector2 {
  T x, y;
  Vector2() = default;
  constexpr Vector2(T a, T b) : x(a), y(b) {}
  template <class A, class B>
  constexpr explicit Vector2(A a, B b) : x(T(a)), y(T(b)) {}
  constexpr explicit Vector2(T s) : x(s), y(s) {}
  template <class U>
  constexpr explicit Vector2(Vector2<U> v) : x(T(v.x)), y(T(v.y)) {}
  template <class U>
  constexpr explicit Vector2(Vector3<U> v) : x(T(v.x)), y(T(v.y)) {}
  template <class U>
  constexpr explicit Vector2(Vector4<U> v) : x(T(v.x)), y(T(v.y)) {}
  RIDGECAST_PARTS(Vector2)
  constexpr T& operator[](int i) { return i <= 0 ? x : y; }
  constexpr const T& operator[](int i) const { return i <= 0 ? x : y; }
};
template <class T>
struct Vector3 {
  T x, y, z;
  Vector3() = default;
  constexpr Vector3(T a, T b, T c) : x(a), y(b), z(c) {}
  constexpr explicit Vector3(T s) : x(s), y(s), z(s) {}
  constexpr Vector3(Vector2<T> v, T c) : x(v.x), y(v.y), z(c) {}
  constexpr Vector3(T a, Vector2<T> v) : x(a), y(v.x), z(v.y) {}
  constexpr explicit Vector3(const Components<T>& c) : x(c.at[0]), y(c.at[1]), z(c.at[2]) {}
  template <class A, class B, class... C>
  constexpr explicit Vector3(A a, B b, C... c) : Vector3(Components<T>(a, b, c...)) {}
  template <class U>
  constexpr explicit Vector3(Vector3<U> v) : x(T(v.x)), y(T(v.y)), z(T(v.z)) {}
  template <class U>
  constexpr explicit Vector3(Vector4<U> v) : x(T(v.x)), y(T(v.y)), z(T(v.z)) {}
  RIDGECAST_PARTS(Vector3)
  constexpr T& operator[](int i) { return i <= 0 ? x : i == 1 ? y : z; }
  constexpr const T& operator[](int i) const { return i <= 0 ? x : i == 1 ? y : z; }
};
template <class T>
struct Vector4 {
  T x, y, z, w;
  Vector4() = default;
  constexpr Vector4(T a, T b, T c, T d) : x(a), y(b), z(c), w(d) {}
  constexpr explicit Vector4(T s) : x(s), y(s), z(s), w(s) {}
  constexpr Vector4(Vector3<T> v, T d) : x(v.x), y(v.y), z(v.z), w(d) {}
  constexpr Vector4(T a, Vector3<T> v) : x(a), y(v.x), z(v.y), w(v.z) {}
  constexpr Vector4(Vector2<T> v, T c, T d) : x(v.x), y(v.y), z(c), w(d) {}
  constexpr Vector4(T a, T b, Vector2<T> v) : x(a), y(b), z(v.x), w(v.y) {}
  constexpr Vector4(T a, Vector2<T> v, T d) : x(a), y(v.x), z(v.y), w(d) {}
  constexpr Vector4(Vector2<T> v, Vector2<T> u) : x(v.x), y(v.y), z(u.x), w(u.y) {}
  constexpr explicit Vector4(const Components<T>& c) : x(c.at[0]), y(c.at[1]), z(c.at[2]), w(c.at[3]) {}
  template <class A, class B, class... C>
  constexpr explicit Vector4(A a, B b, C... c) : Vector4(Components<T>(a, b, c...)) {}
  template <class U>
  constexpr explicit Vector4(Vector4<U> v) : x(T(v.x)), y(T(v.y)), z(T(v.z)), w(T(v.w)) {}
  RIDGECAST_PARTS(Vector4)
  constexpr T& operator[](int i) { return i <= 0 ? x : i == 1 ? y : i == 2 ? z : w; }
  constexpr const T& operator[](int i) const { return i <= 0 ? x : i == 1 ? y : i == 2 ? z : w; }
};

using vec2 = Vector2<float>;
using vec3 = Vector3<float>;
using vec4 = Vector4<float>;
using ivec2 = Vector2<int>;
using ivec3 = Vector3<int>;
using ivec4 = Vector4<int>;
using uvec2 = Vector2<uint>;
using uvec3 = Vector3<uint>;
using uvec4 = Vector4<uint>;
using bvec2 = Vector2<bool>;
using bvec3 = Vector3<bool>;
using bvec4 = Vector4<bool>;

// Integer division that no operand can make trap: by zero it gives 0. common/glsl writes a / b as a / over / b and a % b as
// a / rem / b, which C++ groups the same way.
constexpr float divided(float a, float b) { return a / b; }
constexpr int divided(int a, int b) { return b == 0 ? 0 : b == -1 ? int(0u - uint(a)) : a / b; }
constexpr uint divided(uint a, uint b) { return b == 0u ? 0u : a / b; }
constexpr int remainderOf(int a, int b) { return b == 0 || b == -1 ? 0 : a % b; }
constexpr uint remainderOf(uint a, uint b) { return b == 0u ? 0u : a % b; }

// Component by component, with a scalar on either side.
#define RIDGECAST_BOTH(name, expression)                                                             \
  template <class T>                                                                                 \
  constexpr Vector2<T> name(Vector2<T> a, Vector2<T> b) {                                            \
    return {expression(a.x, b.x), expression(a.y, b.y)};                                             \
  }                                                                                                  \
  template <class T>                                                                                 \
  constexpr Vector2<T> name(Vector2<T> a, Same<T> b) {                                               \
    return {expression(a.x, b), expression(a.y, b)};                                                 \
  }                                                                                                  \
  template <class T>                                                                                 \
  constexpr Vector3<T> name(Vector3<T> a, Vector3<T> b) {                                            \
    return {expression(a.x, b.x), expression(a.y, b.y), expression(a.z, b.z)};                       \
  }                                                                                                  \
  template <class T>                                                                                 \
  constexpr Vector3<T> name(Vector3<T> a, Same<T> b) {                                               \
    return {expression(a.x, b), expression(a.y, b), expression(a.z, b)};                             \
  }                                                                                                  \
  template <class T>                                                                                 \
  constexpr Vector4<T> name(Vector4<T> a, Vector4<T> b) {                                            \
    return {expression(a.x, b.x), expression(a.y, b.y), expression(a.z, b.z), expression(a.w, b.w)}; \
  }                                                                                                  \
  template <class T>                                                                                 \
  constexpr Vector4<T> name(Vector4<T> a, Same<T> b) {                                               \
    return {expression(a.x, b), expression(a.y, b), expression(a.z, b), expression(a.w, b)};         \
  }
#define RIDGECAST_SCALAR_FIRST(name, expression)                                             \
  template <class T>                                                                         \
  constexpr Vector2<T> name(Same<T> a, Vector2<T> b) {                                       \
    return {expression(a, b.x), expression(a, b.y)};                                         \
  }                                                                                          \
  template <class T>                                                                         \
  constexpr Vector3<T> name(Same<T> a, Vector3<T> b) {                                       \
    return {expression(a, b.x), expression(a, b.y), expression(a, b.z)};                     \
  }                                                                                          \
  template <class T>                                                                         \
  constexpr Vector4<T> name(Same<T> a, Vector4<T> b) {                                       \
    return {expression(a, b.x), expression(a, b.y), expression(a, b.z), expression(a, b.w)}; \
  }
#define RIDGECAST_PLUS(a, b) T((a) + (b))
#define RIDGECAST_MINUS(a, b) T((a) - (b))
#define RIDGECAST_TIMES(a, b) T((a) * (b))
#define RIDGECAST_OVER(a, b) divided(T(a), T(b))
#define RIDGECAST_REM(a, b) remainderOf(T(a), T(b))
#define RIDGECAST_AND(a, b) T((a) & (b))
#define RIDGECAST_OR(a, b) T((a) | (b))
#define RIDGECAST_XOR(a, b) T((a) ^ (b))
#define RIDGECAST_LEFT(a, b) T((a) << ((b)&T(31)))
#define RIDGECAST_RIGHT(a, b) T((a) >> ((b)&T(31)))
RIDGECAST_BOTH(operator+, RIDGECAST_PLUS)
RIDGECAST_SCALAR_FIRST(operator+, RIDGECAST_PLUS)
RIDGECAST_BOTH(operator-, RIDGECAST_MINUS)
RIDGECAST_SCALAR_FIRST(operator-, RIDGECAST_MINUS)
RIDGECAST_BOTH(operator*, RIDGECAST_TIMES)
RIDGECAST_SCALAR_FIRST(operator*, RIDGECAST_TIMES)
RIDGECAST_BOTH(operator/, RIDGECAST_OVER)
RIDGECAST_SCALAR_FIRST(operator/, RIDGECAST_OVER)
RIDGECAST_BOTH(divided, RIDGECAST_OVER)
RIDGECAST_SCALAR_FIRST(divided, RIDGECAST_OVER)
RIDGECAST_BOTH(remainderOf, RIDGECAST_REM)
RIDGECAST_SCALAR_FIRST(remainderOf, RIDGECAST_REM)
RIDGECAST_BOTH(operator&, RIDGECAST_AND)
RIDGECAST_BOTH(operator|, RIDGECAST_OR)
RIDGECAST_BOTH(operator^, RIDGECAST_XOR)
RIDGECAST_BOTH(operator<<, RIDGECAST_LEFT)
RIDGECAST_BOTH(operator>>, RIDGECAST_RIGHT)
#define RIDGECAST_ASSIGN(op)                                 \
  template <class T, class B>                                \
  constexpr Vector2<T>& operator op##=(Vector2<T>& a, B b) { \
    return a = a op b;                                       \
  }                                                          \
  template <class T, class B>                                \
  constexpr Vector3<T>& operator op##=(Vector3<T>& a, B b) { \
    return a = a op b;                                       \
  }                                                          \
  template <class T, class B>                                \
  constexpr Vector4<T>& operator op##=(Vector4<T>& a, B b) { \
    return a = a op b;                                       \
  }
RIDGECAST_ASSIGN(+)
RIDGECAST_ASSIGN(-)
RIDGECAST_ASSIGN(*)
RIDGECAST_ASSIGN(&)
RIDGECAST_ASSIGN(|)
RIDGECAST_ASSIGN(^)
RIDGECAST_ASSIGN(<<)
RIDGECAST_ASSIGN(>>)
template <class T>
constexpr Vector2<T> operator-(Vector2<T> a) {
  return {-a.x, -a.y};
}
template <class T>
constexpr Vector3<T> operator-(Vector3<T> a) {
  return {-a.x, -a.y, -a.z};
}
template <class T>
constexpr Vector4<T> operator-(Vector4<T> a) {
  return {-a.x, -a.y, -a.z, -a.w};
}
template <class T>
constexpr bool operator==(Vector2<T> a, Vector2<T> b) {
  return a.x == b.x && a.y == b.y;
}
template <class T>
constexpr bool operator==(Vector3<T> a, Vector3<T> b) {
  return a.x == b.x && a.y == b.y && a.z == b.z;
}
template <class T>
constexpr bool operator==(Vector4<T> a, Vector4<T> b) {
  return a.x == b.x && a.y == b.y && a.z == b.z && a.w == b.w;
}

#ifdef __SSE4_1__
inline float floor(float v) { return __builtin_floorf(v); }
#else
// No rounding instruction here, and a call would stop the vectoriser. From 2^23 on every float is whole.
inline float floor(float v) {
  const float whole = static_cast<float>(static_cast<int>(v));
  const float down = whole - (whole > v ? 1.0f : 0.0f);
  return __builtin_fabsf(v) < 8388608.0f ? down : v;
}
#endif
inline float sqrt(float v) { return __builtin_sqrtf(v); }
inline uint floatBitsToUint(float v) { return __builtin_bit_cast(uint, v); }
inline int floatBitsToInt(float v) { return __builtin_bit_cast(int, v); }
inline float uintBitsToFloat(uint v) { return __builtin_bit_cast(float, v); }
inline float intBitsToFloat(int v) { return __builtin_bit_cast(float, v); }
inline float abs(float v) { return __builtin_fabsf(v); }
constexpr int abs(int v) { return v < 0 ? int(0u - uint(v)) : v; }
constexpr float min(float a, float b) { return b < a ? b : a; }
constexpr int min(int a, int b) { return b < a ? b : a; }
constexpr uint min(uint a, uint b) { return b < a ? b : a; }
constexpr float max(float a, float b) { return a < b ? b : a; }
constexpr int max(int a, int b) { return a < b ? b : a; }
constexpr uint max(uint a, uint b) { return a < b ? b : a; }
constexpr float clamp(float v, float low, float high) { return min(max(v, low), high); }
constexpr int clamp(int v, int low, int high) { return min(max(v, low), high); }
constexpr uint clamp(uint v, uint low, uint high) { return min(max(v, low), high); }
constexpr float mix(float a, float b, float t) { return a * (1.0f - t) + b * t; }
constexpr vec2 mix(vec2 a, vec2 b, float t) { return a * (1.0f - t) + b * t; }
constexpr vec3 mix(vec3 a, vec3 b, float t) { return a * (1.0f - t) + b * t; }
constexpr float smoothstep(float low, float high, float v) {
  const float t = clamp((v - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}
constexpr float dot(vec2 a, vec2 b) { return a.x * b.x + a.y * b.y; }
constexpr float dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
constexpr float dot(vec4 a, vec4 b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }
