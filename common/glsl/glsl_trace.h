// Which expression of a user's file first gave no number, or infinity; included as text after glsl_extras.h and the prelude, for a second
// compilation of a file whose heights turned out so (library.h: Trace).

struct Traced__ {
  const char* name;
  int line;
};
Traced__ traced__[2];  // first NaN, first infinity

inline bool isFinite__(float v) { return v - v == 0.0f; }
inline void trace__(const char* name, int line, float v) {
  Traced__& first = traced__[v == v];
  if (!isFinite__(v) && !first.name) first = {name, line};
}
inline void trace__(const char* name, int line, vec2 v) { trace__(name, line, v.x), trace__(name, line, v.y); }
inline void trace__(const char* name, int line, vec3 v) { trace__(name, line, v.x), trace__(name, line, v.y), trace__(name, line, v.z); }
inline void trace__(const char* name, int line, vec4 v) {
  trace__(name, line, v.x), trace__(name, line, v.y), trace__(name, line, v.z), trace__(name, line, v.w);
}
inline void trace__(const char*, int, int) {}
inline void trace__(const char*, int, uint) {}
template <class T>
inline T tracing__(const char* name, int line, T v) {
  trace__(name, line, v);
  return v;
}

struct OverAt__ {
  int line;
};
template <class A>
struct DividedAt__ {
  A a;
  int line;
};
template <class A>
inline DividedAt__<A> operator/(A a, OverAt__ at) {
  return {a, at.line};
}
template <class A, class B>
inline auto operator/(DividedAt__<A> a, B b) {
  return tracing__("/", a.line, divided(a.a, b));
}

#define over__ \
  OverAt__ { __LINE__ }
#define sqrt(...) tracing__("sqrt", __LINE__, sqrt(__VA_ARGS__))
#define inversesqrt(...) tracing__("inversesqrt", __LINE__, inversesqrt(__VA_ARGS__))
#define pow(...) tracing__("pow", __LINE__, pow(__VA_ARGS__))
#define exp(...) tracing__("exp", __LINE__, exp(__VA_ARGS__))
#define exp2(...) tracing__("exp2", __LINE__, exp2(__VA_ARGS__))
#define log(...) tracing__("log", __LINE__, log(__VA_ARGS__))
#define log2(...) tracing__("log2", __LINE__, log2(__VA_ARGS__))
#define mod(...) tracing__("mod", __LINE__, mod(__VA_ARGS__))
#define normalize(...) tracing__("normalize", __LINE__, normalize(__VA_ARGS__))
