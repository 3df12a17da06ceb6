// GLSL as people write it, one feature a function, through the translation and through a graphics driver: the heights agree. Whatever the
// front end accepts is read right or refused in a sentence of ours.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <string>

#include "common/process/child.h"
#include "common/process/scratch.h"
#include "common/user_terrain/catalogue.h"
#include "tests/support/gpu_heights.h"

namespace ridgecast::glsl {
namespace {

using testing::HasSubstr;

struct Feature {
  const char* name;
  const char* text;      // at the top level
  const char* function;  // of vec2 p within 4 of 0; returns a float
};

constexpr Feature kFeatures[] = {
    {"two components exchanged", "", "p.xy = p.yx; return p.x + 2.0 * p.y;"},
    {"a plane turned", "", "vec3 q = vec3(p, 1.0); q.xz *= mat2(0.8, -0.6, 0.6, 0.8); return q.x + 2.0 * q.y + 4.0 * q.z;"},
    {"a macro that turns", "#define rot(a) mat2(cos(a), sin(a), -sin(a), cos(a))\n",
     "vec3 q = vec3(p, 1.0); q.yz *= rot(p.x * 0.3); q.xy *= rot(0.7); return q.x + 2.0 * q.y + 4.0 * q.z;"},
    {"a vector added", "", "vec3 q = vec3(p, 2.0); q.zx += p * 3.0; return q.x + 2.0 * q.y + 4.0 * q.z;"},
    {"a number subtracted", "", "vec4 q = vec4(p, p); q.wy -= 1.5; q.xz -= q.yw; return dot(q, vec4(1.0, 2.0, 4.0, 8.0));"},
    {"components divided", "", "vec3 q = vec3(p, 7.0); q.xz /= 2.0; q.zy /= p + 5.0; return q.x + 2.0 * q.y + 4.0 * q.z;"},
    {"three of four", "",
     "vec4 q = vec4(1.0, 2.0, p); vec3 r = vec3(0.0); r.zxy = q.wzy; r.rgb += q.rrr; return r.x + 2.0 * r.y + 4.0 * r.z;"},
    {"one of several", "", "vec3 q = vec3(p, 1.0); q.zx[1] = 3.0; q.xy[0] += q.z; return q.x + 2.0 * q.y + 4.0 * q.z;"},
    {"components counted up", "",
     "vec3 q = vec3(p, 1.0); vec2 before = q.xz++; ++q.zy; --q.xy; q.yz--; return dot(q, vec3(1.0, 2.0, 4.0)) + before.x * before.y;"},
    {"of an array", "",
     "vec3 a[2] = vec3[2](vec3(p, 1.0), vec3(2.0)); int i = p.x > 0.0 ? 1 : 0; a[i].xz += p; ++a[1 - i].xy; return dot(a[0], a[1]);"},
    {"of a struct", "struct Ray { vec3 o; vec3 d; };\n",
     "Ray r = Ray(vec3(p, 0.0), vec3(0.0, 1.0, 2.0)); r.o.xz *= 2.0; r.d.zx = r.o.xy; return dot(r.o, r.d);"},
    {"members called as components are",
     "struct Struck { float t; vec3 r, xy; float w[2], s; };\nstruct Strikes { Struck a[2]; vec2 t; };\n"
     "Struck struck(vec2 p) { Struck h; h.t = p.x; h.r = vec3(p, 1.0); h.xy = h.r.yxz; h.w[1] = 2.0; h.s = 4.0; return h; }\n",
     "Struck h = struck(p); Strikes q = Strikes(Struck[2](h, struck(p.yx)), p * 2.0); vec3 c = h.r; c.r += 0.5; c.xy *= q.a[1].r.t; "
     "for (int i = 0; i < 2; ++i) { Struck t = q.a[i]; c.t += t.t * (t).r.s; t.r.t = 3.0; c.st += t.r.st; } "
     "return c.r + c.g * 2.0 + struck(p.ts).t + (h = q.a[1]).xy.r + q.t.t + normalize(p + 9.0).r + struck(p).w[1] + q.a[0].s;"},
    {"a matrix's components", "",
     "mat3 m = mat3(p.x, p.y, 1, 2, 3, 4, 5, 6, 7); mat2 k = mat2(p, p.yx); mat4 n = mat4(m); return dot(vec4(k), vec4(1, 2, 4, 8)) + "
     "dot(vec3(m), vec3(1, 2, 4)) + float(k) + dot(vec3(k), vec3(1, 2, 4)) + dot(vec4(m), vec4(1, 2, 4, 8)) + vec4(n).y + vec2(n).x;"},
    {"conditions that declare", "",
     "float s = 0.0; int n = 0; while (bool more = n < 5) { ++n; if (n == 3) continue; s += more ? p.x : 0.0; } for (int i = 0; bool more "
     "= "
     "i < 4; ++i) { if (i == 2) continue; if (i == 3) break; s += p.y * float(more); } while (bool n = s < 9.0) s += float(n); return s;"},
    {"a selection of a selection", "",
     "vec4 q = vec4(p, 3.0, 4.0); q.wzyx.yz = p; float a = q.zyx.xy.y; q.xyz.zx *= 2.0; return a + dot(q, vec4(1.0, 2.0, 4.0, 8.0));"},
    {"assigned on and on", "", "vec3 q = vec3(0.0), r; q.xy = r.yz = p * 2.0; r.x = 1.0; return dot(q + r.yzx, vec3(1.0, 2.0, 4.0));"},
    {"integers' components", "",
     "ivec3 c = ivec3(floor(vec3(p, 9.0))); c.xyz += 13; c.zy <<= 1; c.yx %= 5; c.xy |= ivec2(1, 2); return float(c.x + 10 * c.y + 100 * "
     "c.z);"},
    {"handed to a function", "void pR(inout vec2 p, float a) { p = cos(a) * p + sin(a) * vec2(p.y, -p.x); }\n",
     "vec3 q = vec3(p, 1.0); pR(q.xz, 0.5); if (p.x > 0.0) pR(q.zy, p.y); else pR(q.yx, 0.2); return dot(q, vec3(1.0, 2.0, 4.0));"},
    {"one handed to a function",
     "float pMod1(inout float p, float size) { float h = size * 0.5; float c = floor((p + h) / size); p = mod(p + h, size) - h; return c; "
     "}\n",
     "float c = pMod1(p.x, 0.75); return c * 10.0 + p.x + p.y;"},
    {"written by a function", "void both(vec2 v, out vec2 a, out vec3 b) { a = v * 2.0; b = vec3(v, 1.0); }\n",
     "vec4 q = vec4(1.0); vec4 r = vec4(2.0); both(p, q.wx, r.zyx); return dot(q, vec4(1.0, 2.0, 4.0, 8.0)) + dot(r, vec4(3.0, 5.0, 7.0, "
     "9.0));"},
    {"overloads that write", "void twice(inout vec2 v) { v *= 2.0; }\nvoid twice(inout vec3 v) { v *= 3.0; }\n",
     "vec4 q = vec4(p, 1.0, 2.0); twice(q.xz); twice(q.wyx); return dot(q, vec4(1.0, 2.0, 4.0, 8.0));"},
    {"mat4", "",
     "float c = cos(p.x), s = sin(p.x); mat4 m = mat4(c, s, 0, 0, -s, c, 0, 0, 0, 0, 1, 0, 0.5, p.y, 2, 1); return dot(m * vec4(p, 1.0, "
     "1.0) + vec4(p, 1, 2) * m, vec4(1.0, 2.0, 4.0, 8.0));"},
    {"mat4 of columns", "",
     "mat4 m = mat4(vec4(p, 0, 1), vec4(1, p, 2), vec4(0, 0, 3, 1), vec4(2)); m[1].xz = p; m[3][2] = 5.0; return (m * m)[2].y + m[1][0];"},
    {"transpose", "",
     "mat3 m = mat3(p, 1.0, 2.0, p.yx, 4.0, 5.0, 6.0); mat4 n = mat4(m); return dot(transpose(m) * vec3(1.0, 2.0, 3.0), vec3(p, 1.0)) + "
     "(transpose(n) * vec4(p, p)).z + transpose(mat2(m))[0].y;"},
    {"inverse", "",
     "mat2 a = mat2(3.0, p.x, 0.5, 6.0); mat3 b = mat3(9.0, p.x, 1.0, p.y, 8.0, 2.0, 0.0, 1.0, 7.0); mat4 c = mat4(b); c[3] = vec4(1, 2, "
     "p.x, 9); return dot(inverse(a) * p, p) + dot(inverse(b) * vec3(p, 1), vec3(1, 2, 4)) + dot(inverse(c) * vec4(p, 1, 2), vec4(1, 2, 4, "
     "8));"},
    {"determinant", "",
     "return determinant(mat2(p, 1.0, 2.0)) + determinant(mat3(vec3(p, 1), vec3(2, p), vec3(1, 2, 4))) + determinant(mat4(vec4(p, p.yx), "
     "vec4(1, 2, 3, 5), vec4(2, p, 1), vec4(7, 1, 2, 1)));"},
    {"the golfed rotation", "", "p *= mat2(cos(0.6 + vec4(0, 33, 11, 0))); return p.x + 2.0 * p.y;"},
    {"corners of matrices", "",
     "mat4 m = mat4(2.0); m[0].yz = p; mat3 n = mat3(m); n[2] += vec3(p, 0.0); mat2 k = mat2(n); return dot(n * vec3(1, 2, 3), vec3(1)) + "
     "k[0].y + dot(k * p, p);"},
    {"sums of matrices", "",
     "mat2 a = mat2(p, p.yx), b = mat2(1.5); a += b; a = 2.0 * a - b / 4.0 - a * b + 1.0; a /= p.x + 9.0; a[1] -= p; mat3 c = mat3(2.0) * "
     "p.x; c = -c / 3.0 + mat3(1.0); return dot(a * p, p) + c[1].y;"},
    {"other products of matrices", "",
     "mat2 a = outerProduct(p, p.yx + 1.0); mat3 b = outerProduct(vec3(p, 1), vec3(1, p)); return dot(matrixCompMult(a, mat2(1, 2, 3, 4)) "
     "* p, vec2(1)) + dot(b * vec3(1, 2, 3), vec3(1));"},
    {"equal matrices", "", "mat2 a = mat2(floor(p), 1.0, 2.0); return a == mat2(0.0, 0.0, 1.0, 2.0) ? 5.0 : a != mat2(1.0) ? p.x : 7.0;"},
    {"a macro on several lines", "#define TWICE(a) \\\n  ((a) + \\\n   (a))\n", "return TWICE(p.x) + 1.0;"},
    {"mixed constructors", "",
     "vec3 a = vec3(ivec2(floor(p)), 1.0); vec4 b = vec4(p.x, ivec2(2, 3), true); vec4 c = vec4(a.xy, ivec2(p)); return dot(b, c) + a.x + "
     "vec2(bvec2(p.x > 0.0, true)).x + float(ivec3(p, 4).z);"},
    {"a number of a vector", "", "return float(p.yx) * 2.0 + float(int(vec3(p, 1.0)));"},
    {"arcs of vectors", "", "vec2 q = p / 4.5; return asin(q).x + acos(q).y * 2.0 + atan(p).x * 4.0 + atan(p, vec2(1.5)).y;"},
    {"hyperbolic functions", "", "return sinh(p.x * 0.1) + cosh(p.y * 0.5) + tanh(vec3(p, 1.0)).y + sinh(p * 0.7).y;"},
    {"their inverses", "", "return asinh(p.x) + acosh(1.5 + abs(p.y)) + atanh(p.x * 0.2) + asinh(p).y;"},
    {"steps of vectors", "",
     "vec4 q = vec4(p, p.yx * 0.5); return dot(smoothstep(-1.0, 2.0, q), vec4(1, 2, 4, 8)) + dot(step(vec4(0.1, 0.2, 0.3, 0.4), q), "
     "vec4(1, 2, 4, 8)) + step(0.5, q.xyz).z;"},
    {"between vectors", "",
     "vec4 q = vec4(p, 1, 2); vec3 r = mix(q.xyz, q.yzw, bvec3(true, p.x > 0.0, false)); return dot(clamp(q, vec4(-1), vec4(1, 2, 3, 1)), "
     "vec4(1)) + dot(mix(q, q.wzyx, vec4(0.1, 0.2, 0.3, 0.4)), vec4(1, 2, 4, 8)) + dot(r, vec3(1, 2, 4)) + clamp(q, -0.5, 0.5).x;"},
    {"light", "",
     "vec3 n = normalize(vec3(p, 3.0)), v = normalize(vec3(1.0, p)); return dot(reflect(v, n), vec3(1, 2, 4)) + dot(refract(v, n, 0.8), "
     "vec3(1, 2, 4)) + dot(faceforward(n, v, n), vec3(1, 2, 4));"},
    {"whole and rest", "",
     "float whole; vec2 w; float r = modf(p.x * 3.0, whole); vec2 q = modf(p, w); vec3 both = vec3(0.0); vec2 s; s = p; modf(s, both.zx); "
     "return r + whole * 10.0 + q.y + w.x * 3.0 + both.z * 7.0 + both.x;"},
    {"comparisons", "",
     "bvec3 b = lessThanEqual(vec3(p, 1.0), vec3(0.5, 1.0, 1.0)); bvec2 c = not(greaterThanEqual(ivec2(floor(p)), ivec2(1))); bvec2 d = "
     "equal(floor(p), vec2(0.0)); return float(b.x) + 2.0 * float(b.y) + 4.0 * float(all(c)) + 8.0 * float(any(d)) + 16.0 * "
     "float(notEqual(uvec2(1u), uvec2(1u, 2u)).y);"},
    {"whole vectors", "",
     "ivec3 c = clamp(ivec3(floor(vec3(p * 3.0, 9.0))), -4, 5); c = min(c, ivec3(3)) + max(c, 1) - ~c + (c >> 1) + abs(c) * sign(c); "
     "return float(c.x + 2 * c.y + 4 * c.z);"},
    {"a hash of integers",
     "uvec3 pcg3d(uvec3 v) { v = v * 1664525u + 1013904223u; v.x += v.y * v.z; v.y += v.z * v.x; v.z += v.x * v.y; v ^= v >> 16u; v.x += "
     "v.y * v.z; return v; }\n",
     "uvec3 h = pcg3d(uvec3(ivec3(floor(vec3(p * 5.0, 2.0))))); return float(h.x >> 16u) / 65536.0 + float(h.y & 255u);"},
    {"bits", "",
     "ivec2 b = floatBitsToInt(p); uvec3 u = floatBitsToUint(vec3(p, 1.0)); return intBitsToFloat(b & 0x7fffffff).x + uintBitsToFloat(u).y "
     "+ float(u.z >> 23u);"},
    {"equal structs", "struct Pair { vec2 a; float b; };\n",
     "Pair a = Pair(floor(p), 1.0), b = Pair(vec2(0.0), 1.0); return a == b ? 3.0 : a != Pair(vec2(1.0), 1.0) ? 4.0 : 5.0;"},
    {"equal arrays", "", "float a[2] = float[2](floor(p.x), 1.0); return a == float[2](1.0, 1.0) ? 3.0 : 4.0;"},
    {"octaves",
     "const mat2 m2 = mat2(1.6, -1.2, 1.2, 1.6);\nfloat bumps(vec2 p) { return sin(p.x) * cos(p.y); }\nfloat fbm(vec2 p) { float f = 0.0, "
     "a = 0.5; for (int i = 0; i < 5; i++) { f += a * bumps(p); p = m2 * p; a *= 0.5; } return f; }\n",
     "return fbm(p) * 3.0;"},
    {"warped octaves",
     "const mat2 m2b = mat2(0.80, 0.60, -0.60, 0.80);\nfloat w(vec2 p) { return sin(p.x + sin(p.y)); }\nfloat fbm4(vec2 p) { float f = "
     "0.0; f += 0.5 * w(p); p = m2b * p * 2.02; f += 0.25 * w(p); p *= m2b * 2.03; f += 0.125 * w(p); return f / 0.875; }\n",
     "vec2 q = vec2(fbm4(p), fbm4(p + vec2(5.2, 1.3))); return fbm4(p + 4.0 * q);"},
    {"a hash without a sine",
     "vec2 hash22(vec2 p) { vec3 p3 = fract(vec3(p.xyx) * vec3(.1031, .1030, .0973)); p3 += dot(p3, p3.yzx + 3.33); return fract((p3.xx + "
     "p3.yz) * p3.zy); }\n",
     "vec2 h = hash22(floor(p)); return h.x + 2.0 * h.y;"},
    {"cells",
     "vec2 cellOf(vec2 n) { return fract(vec2(n.x * 0.37 + n.y * 0.73, n.y * 0.41 + n.x * 0.19)); }\nfloat voronoi(vec2 x) { vec2 n = "
     "floor(x), f = fract(x); float d = 8.0; for (int j = -1; j <= 1; j++) for (int i = -1; i <= 1; i++) { vec2 g = vec2(float(i), "
     "float(j)); vec2 r = g + cellOf(n + g) - f; d = min(d, dot(r, r)); } return sqrt(d); }\n",
     "return voronoi(p) * 4.0;"},
    {"triangles",
     "float tri(float x) { return abs(fract(x) - .5); }\nvec2 tri2(vec2 p) { return vec2(tri(p.x + tri(p.y * 2.)), tri(p.y + tri(p.x * "
     "2.))); }\n",
     "float z = 1.5, rz = 0.; vec2 bp = p; for (float i = 0.; i <= 3.; i++) { vec2 dg = tri2(bp * 2.) * .8; p += dg; bp *= 1.6; z *= 1.8; "
     "p *= 1.2; p *= mat2(.970, .242, -.242, .970); rz += tri(p.x + tri(p.y)) / z; } return rz * 4.0;"},
    {"noise with its slope",
     "vec3 noised(vec2 x) { vec2 f = fract(x), i = floor(x); vec2 u = f * f * (3.0 - 2.0 * f), du = 6.0 * f * (1.0 - f); float a = "
     "fract(i.x * .3 + i.y * .7), b = fract(i.x * .5 + .2), c = fract(i.y * .9 + .1), d = .4; return vec3(a + (b - a) * u.x + (c - a) * "
     "u.y + (a - b - c + d) * u.x * u.y, du * (vec2(b - a, c - a) + (a - b - c + d) * u.yx)); }\n",
     "float a = 0.0, b = 1.0; vec2 d = vec2(0.0); for (int i = 0; i < 4; i++) { vec3 n = noised(p); d.xy += n.yz; a += b * n.x / (1.0 + "
     "dot(d, d)); b *= 0.5; p.xy = mat2(0.8, -0.6, 0.6, 0.8) * p.xy * 2.0; } return a * 5.0;"},
    {"folds", "",
     "vec3 z = vec3(p, 0.3); for (int i = 0; i < 4; ++i) { z = abs(z); if (z.x < z.y) z.xy = z.yx; if (z.x < z.z) z.xz = z.zx; if (z.y < "
     "z.z) z.yz = z.zy; z = z * 1.5 - vec3(0.5, 0.4, 0.3); z.xy *= mat2(0.9, 0.1, -0.1, 0.9); } return dot(z, vec3(1, 2, 4));"},
    {"vectors counted", "",
     "vec2 v = p; vec2 a = v++; --v; ++v; v--; ivec2 c = ivec2(1, 2); c++; return dot(v + a, vec2(1, 3)) + float((+c).y) + dot(-v, p);"},
    {"two counters", "", "float s = 0.0; for (int i = 0, j = 5; i < j; i++, j--) s += float(i * j) * p.x; return s;"},
    {"leaving early",
     "float early(const in float v) { if (v < 0.0) return -1.0; int n = 0; do { n++; if (n > 5) break; } while (float(n) < v); switch (n) "
     "{ case 1: return 10.0; case 2: case 3: n += 2; break; default: n = 7; } return float(n); }\n",
     "return early(p.x) + early(p.y + 2.0);"},
    {"tables", "const vec2 offsets[3] = vec2[3](vec2(0.1, 0.2), vec2(-0.5, 0.6), vec2(1.0, -1.0));\nconst int many = 3;\n",
     "float d = 9.0; for (int i = 0; i < many; i++) d = min(d, distance(p, offsets[i])); return d + float(offsets.length());"},
    {"macros of macros",
     "#define S(a, b, t) smoothstep(a, b, t)\n#define sat(x) clamp(x, 0., 1.)\n#define DEEP 2\n#if DEEP > 1\n#define PEAK(x) sat(S(-1., "
     "2., x))\n#else\n#define PEAK(x) x\n#endif\n",
     "return PEAK(p.x) * 5.0 + S(.0, 1., p.y);"},
    {"modulo of vectors", "",
     "vec2 a = mod(p, 1.3) - 0.65, b = mod(p, vec2(0.7, 1.1)); vec3 c = mod(vec3(p, -2.5), 0.9); return a.x + 2.0 * a.y + 4.0 * b.x + b.y "
     "+ dot(c, vec3(1, 2, 4));"},
    {"lengths", "",
     "vec4 q = vec4(p, 1.0, 2.0); return length(q) + distance(q, vec4(1.0)) + dot(normalize(q), vec4(1, 2, 4, 8)) + length(p.x) + "
     "distance(p.x, 1.0);"},
    {"words of C++", "float union1(float template1, float delete) { return min(template1, delete); }\n",
     "float new = p.x, not_eq = 2.0, and = p.y; return union1(new, and) + not_eq;"},
    {"names in their own initialisers", "struct Hit { float d; };\nHit hit(vec2 p) { return Hit(p.x * 2.0); }\nconst float K = 3.0;\n",
     "float d = length(p); if (d > 1.0) { float d = d - 1.0; p.x += d; } float length = length(p); Hit hit = hit(p); { float K = K * p.x, "
     "e = K + 1.0; p.y += e; } float a[2] = float[2](1.0, p.x); { float a[2] = float[2](a[1] * 2.0, a[0]); d += a[0] + a[1]; } int n = 2; "
     "for "
     "(int n = n + 1; n < 6; n++) d += float(n); return d + length + hit.d + p.x + p.y + K + float(n);"},
    {"bounds that are shadowed",
     "const int MANY = 3;\nfloat ring(float v, int MANY) { float s = 0.0; for (int i = 0; i < MANY; i++) s += v; return s; }\n",
     "float s = ring(p.x, 7); const int MANY = 6; for (int i = 0; i < MANY; i++) s += p.y; return s;"},
    {"whole numbers of 32 bits", "float kind(int v) { return 1.0; }\nfloat kind(uint v) { return 2.0; }\n",
     "return float(0x80000000 >> 28) + float(0xC0000000) * 1e-9 + (0xffffffff < 0 ? p.x : p.y) + kind(0xfffffff0) + float(3000000000) * "
     "1e-9 + "
     "float(0x80000000u >> 28u);"},
    {"overloads of the program's functions", "float wave(int n) { return float(n) * 100.0; }\nfloat plainNoise(float v) { return v; }\n",
     "return wave(p.x * 0.3) + wave(2) + plainNoise(p.y);"},
    {"selections in brackets", "",
     "vec3 q = vec3(p, 1.0); (q.xz) = p; (q.xz)[1] += p.y; (q.zy[0]) += 3.0; ((q.yx)) *= 2.0; (q.xz[0])++; ++(q.zy); (q.xy)--; return "
     "dot(q, vec3(1, 2, 4));"},
    {"one of several handed on", "void inc(inout float v) { v += 3.0; }\nvoid both(inout vec2 v) { v = v.yx + 1.0; }\n",
     "vec3 q = vec3(p, 1.0); inc(q.zx[1]); inc(q.xyz.yz[0]); both((q.xz)); float r = p.x; if (r > 0.0) both(q.yz); for (int i = 0; i < 2; "
     "i++) both(q.zy); do both(q.xy); "
     "while (r++ < 0.0); switch (int(r > 1.0)) { case 0: both(q.zx); break; default: both(q.xy); } return dot(q, vec3(1, 2, 4));"},
    {"overloads that write or not", "float turn(vec2 v) { return v.x; }\nfloat turn(inout vec3 v) { v *= 2.0; return v.y; }\n",
     "vec4 q = vec4(p, 1.0, 2.0); float a = turn(q.xz) + turn(q.wy); turn(q.zxy); turn(q.xy); return a + dot(q, vec4(1, 2, 4, 8));"},
    {"vectors divided", "",
     "vec2 v = p + 9.0; v /= p + 7.0; vec3 w = vec3(p, 3.0); w /= dot(v, v) + 1.0; w /= 2.0; ivec2 c = ivec2(p + 40.0); c /= 3; c %= 7; "
     "return dot(w, vec3(1, 2, 4)) + v.x + float(c.x + c.y);"},
    {"several declared at once",
     "struct Grid { float w[3], bias; vec2 at[2], c; };\nconst float A = 1.0, B[2] = float[2](2.0, 3.0), C = 4.0;\n",
     "float a[3], b = 2.0, c[2]; a[0] = p.x; a[2] = b; c[1] = p.y; float[2] d = float[2](1.0, p.x), e = d; Grid g; g.w[1] = p.x; g.bias = "
     "1.0; g.at[1] = p; g.c = p.yx; "
     "return a[0] + a[2] + c[1] + float(a.length() + c.length()) + e[1] + g.w[1] + g.bias + g.at[1].y + g.c.x + A + B[1] + C;"},
    {"declared between cases", "",
     "float r = 0.0; switch (int(floor(p.x))) { case 0: float a = p.y; r = a; break; case 1: const vec2 b = vec2(2.0); r = b.x * p.x; "
     "break; default: float c[2] = float[2](p.x, 3.0); r = c[0] + c[1]; } return r;"},
    {"counters that are changed", "void skip(inout int n) { n += 1; }\n",
     "float s = 0.0; for (int i = 0; i < 9; i++) { skip(i); s += float(i) * p.x; } for (int j = 0; j < 9; j++) { (j)++; s += p.y; } for "
     "(int k = 0; k < 4; k++) { { int k = k * 2; s += float(k); } } return s;"},
    {"a struct of a function", "",
     "struct Part { float weight; vec2 at[2]; } ; Part a, b; a.weight = 1.0; a.at[0] = p; a.at[1] = p.yx; b = a; Part l[2] = Part[2](a, "
     "b); b.weight = floor(p.x); return (a == b ? 3.0 : 4.0) + l[1].at[1].x + l[0].weight;"},
    {"names like textures'", "float textureOf(vec2 q) { return q.x; }\nstruct friend { vec2 a; };\n",
     "float textured = 2.0, fwidthScale = 3.0; friend f[2]; f[1].a = p; return textureOf(p) * textured + fwidthScale + f[1].a.y;"},
    {"sizes that are computed", "const int N = 6;\nfloat sum(float a[max(2, 3)], float s) { return a[0] + a[2] * s; }\n",
     "float a[N >> 1]; float b[N > 4 ? 3 : 2]; a[2] = p.x; a[0] = 1.0; b[2] = p.y; return sum(a, 2.0) + b[2] + float(a.length() * 10 + "
     "b.length());"},
    {"shifts of mixed signs", "",
     "uvec2 u = uvec2(floor(p) + 9.0) << ivec2(1, 2); u >>= ivec2(1, 0); ivec3 c = ivec3(floor(vec3(p, 9.0)) + 8.0); c.zx <<= uvec2(1u, "
     "3u); return float(u.x + u.y) + float(c.x + c.z);"},
    {"matrices counted", "",
     "mat2 m = mat2(p, 1.0, 2.0); mat2 b = m++; ++m; --m; m = +m; vec4 v = vec4(b); m += mat2(ivec4(1, 2, 3, 4)); return dot(m * p, "
     "vec2(1)) + dot(v, vec4(1, 2, 4, 8)) + float(bool(floor(p)));"},
    {"scalars first", "",
     "return dot(2.0 / (p + 9.0) - 1.0 + 3.0 * p, vec2(1, 2)) + float((7 & ivec2(floor(p))).x + (1 | ivec2(2)).y + (5 ^ "
     "ivec2(floor(p))).y);"},
};

std::string textOf() {
  std::string text, choice;
  for (std::size_t k = 0; const Feature& f : kFeatures) {
    text += std::string(f.text) + "float feature" + std::to_string(k) + "(vec2 p) { " + f.function + " }\n";
    choice += "  if (cell.x == " + std::to_string(k) + ") return feature" + std::to_string(k) + "(p);\n";
    ++k;
  }
  return text + "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {\n  vec2 p = fraction * 8.0 - 4.0;\n" +
         choice +
         "  return 0.0;\n}\nvec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return "
         "normal; }\n";
}

class Features : public testing_support::HeadlessGl {
 protected:
  void SetUp() override {
    if (!process::findProgram("glslangValidator") || !(process::findProgram("g++") || process::findProgram("c++")))
      GTEST_SKIP() << "needs glslangValidator and g++";
    HeadlessGl::SetUp();
  }
  Outcome<std::shared_ptr<const terrain::Terrain>> made(const std::string& text) const {
    const std::filesystem::path file = folder_.path() / "feature.glsl";
    std::ofstream(file, std::ios::binary) << text;
    user_terrain::Request r;
    r.terrain = file.string();
    r.build.cache = folder_.path() / "cache";
    r.build.prober = RIDGECAST_SERVER;
    return user_terrain::load(r, nullptr);
  }
  process::Scratch folder_ = process::Scratch::create().value();
};

TEST_F(Features, AreTheSameHeightsOnBothSides) {
  const auto terrain = made(textOf());
  ASSERT_TRUE(terrain) << terrain.error().message;
  const testing_support::GpuHeights gpu(**terrain);
  for (std::size_t k = 0; const Feature& f : kFeatures) {
    std::vector<lattice::Step> x, z;
    for (int i = 0; i < 1024; ++i) {
      x.push_back((static_cast<lattice::Step>(k) << lattice::kCellBits) + (i * 977 % 1024) * 1024 + 517);
      z.push_back((i * 331 % 1024) * 1024 + 211);
    }
    const std::vector<float> drawn = gpu.at(x, z);
    std::vector<float> computed(x.size());
    (*terrain)->heights(x, z, computed);
    int different = 0;
    double spread = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      different += !(std::abs(drawn[i] - computed[i]) <= 2e-3 * (1 + std::abs(drawn[i])));
      spread = std::max(spread, std::abs(double{drawn[i]} - drawn[0]));
    }
    EXPECT_LE(different, 10) << f.name << ": " << computed[0] << " for " << drawn[0];  // floors round either way
    EXPECT_GT(spread, 0.5) << f.name << ": shows nothing";
    ++k;
  }
}

TEST_F(Features, WhatHeightsLackIsRefusedInASentenceWithItsLine) {
  const auto refusal = [&](const std::string& before, const std::string& body) {
    const auto t = made(
        before + "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {\n  vec3 q = vec3(fraction, 1.0);\n" + body +
        "\n}\nvec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return normal; }\n");
    return t ? std::string("accepted") : t.error().message;
  };
  EXPECT_THAT(refusal("", "mat2x3 m = mat2x3(1.0); return m[0].x;"),
              HasSubstr("feature.glsl:3: heights have square matrices only, no 'mat2x3'"));
  EXPECT_THAT(refusal("", "return dFdx(q.x);"), HasSubstr("feature.glsl:3: 'dFdx' belongs to pictures"));
  EXPECT_THAT(
      refusal("float turned(inout vec2 v) { v *= 2.0; return v.x; }\n", "return turned(q.xz) + q.x;"),
      HasSubstr("feature.glsl:4: where a call's result is used it cannot write several components (.xz); give it a variable of its own"));
  EXPECT_THAT(refusal("", "q.xx = vec2(1.0); return q.x;"), HasSubstr("feature.glsl:3: "));
  EXPECT_THAT(refusal("", "float a = 1.0; \\ \nreturn a;"), HasSubstr("feature.glsl:3: a backslash"));
  EXPECT_THAT(refusal("", "float a[int(floor(4.7))]; a[0] = 1.0; return a[0];"),
              HasSubstr("feature.glsl:3: this GLSL has no counterpart for heights: write it in simpler GLSL"));
}

}  // namespace
}  // namespace ridgecast::glsl
