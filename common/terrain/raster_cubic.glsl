// The surface between the samples of a height map: bicubic (Catmull-Rom), through every sample, with continuous slopes. Compiled as C++
// for the mesh and as GLSL for pictures, bit for bit the same. Samples are whole steps within +-2^23, so floats hold them and their
// differences from one of them.

// Of the four samples' differences, over t / 2. Factored out as far as it goes, so that there is nothing left for a driver to factor.
vec4 rasterWeights(float t) {
  return vec4(held(t * (2.0f - t)) - 1.0f, held(t * (t * 3.0f - 5.0f)), held(t * (4.0f - t * 3.0f)) + 1.0f, held(t * (t - 1.0f)));
}

float rasterRow(vec4 w, vec4 d, float t) {
  float middle = held(held(w.x * d.x) + held(w.y * d.y));
  float outer = held(held(w.z * d.z) + held(w.w * d.w));
  return held(held(middle + outer) * t) * 0.5f;
}

// Height in metres at t in [0, 1)^2 between the samples r1.y and r2.z; rows go along z, components along x.
float rasterCubic(ivec4 r0, ivec4 r1, ivec4 r2, ivec4 r3, vec2 t) {
  int here = r1.y;
  vec4 w = rasterWeights(t.x);
  // w sums to 0: each row is its second sample and what the others differ from it.
  float a = float(r0.y - here) + rasterRow(w, vec4(float(r0.x - here), float(r0.y - here), float(r0.z - here), float(r0.w - here)), t.x);
  float b = float(r1.y - here) + rasterRow(w, vec4(float(r1.x - here), float(r1.y - here), float(r1.z - here), float(r1.w - here)), t.x);
  float c = float(r2.y - here) + rasterRow(w, vec4(float(r2.x - here), float(r2.y - here), float(r2.z - here), float(r2.w - here)), t.x);
  float d = float(r3.y - here) + rasterRow(w, vec4(float(r3.x - here), float(r3.y - here), float(r3.z - here), float(r3.w - here)), t.x);
  a = held(a);
  b = held(b);
  c = held(c);
  d = held(d);
  float height = held(b + rasterRow(rasterWeights(t.y), vec4(a, b, c, d), t.y));
  return held(float(here) + height) * 0.00390625f;
}
