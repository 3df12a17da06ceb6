// Noise on the integer lattice: what every terrain file may call. The same text is compiled by graphics drivers (GLSL 3.30 core, 4.50,
// ES 3.00) and, through glsl_as_cpp.h, as C++: only what all of them understand, and in whatever leads to a height only operations that
// IEEE 754 rounds one way (+ - * / sqrt, floor, min, max, integers).
//
// A *place* is a position as one octave sees it: the square of the octave's lattice and where in it. Going to a finer octave multiplies
// by an integer matrix, whole squares in wrapping integers and fractions in floats that hold them without rounding: 22 bits to begin
// with, at most 24 before the whole part is carried over. So the noise at 10^12 m is as exact as at 0. The matrices also turn, by
// angles that never repeat, which hides the lattice.

// Drivers reorder what is only equal on paper: Mesa turns a b + a c into a (b + c) and moves constants along chains of * and of +,
// and GLSL before 4.00 has no word against it. `held` is a wall that it does not look through: results that later sums and products
// could be merged with go through it. Factors that are powers of two need no wall.
#ifdef __cplusplus
float held(float v) { return v; }
vec2 held(vec2 v) { return v; }
#else
float held(float v) { return max(v, -1.0e30f); }
vec2 held(vec2 v) { return max(v, vec2(-1.0e30f)); }
#endif

struct Place {
  uvec2 cell;  // wraps
  vec2 at;     // [0, 1)
  vec2 slope;  // gradient gathered so far, metres a metre, in the octave's own turned axes
  float height;  // metres gathered so far
};

// Widest octave: squares of 16,384 m.
Place widestPlace(ivec2 cell, vec2 fraction) {
  Place p;
  p.cell = uvec2(uint(cell.x >> 2), uint(cell.y >> 2));
  p.at = vec2((float(cell.x & 3) + fraction.x) * 0.25f, (float(cell.y & 3) + fraction.y) * 0.25f);
  p.slope = vec2(0.0f, 0.0f);
  p.height = 0.0f;
  return p;
}

Place carried(uvec2 cell, vec2 at, vec2 slope, float height) {
  Place p;
  vec2 whole = vec2(floor(at.x), floor(at.y));
  p.cell = uvec2(cell.x + uint(int(whole.x)), cell.y + uint(int(whole.y)));
  p.at = at - whole;
  p.slope = held(slope);
  p.height = held(height);
  return p;
}

// The next octave, finer by the square root of 5 and turned by 26.6 degrees: matrix (2 1; -1 2).
Place finer5(Place p) {
  return carried(uvec2(p.cell.x * 2u + p.cell.y, p.cell.y * 2u - p.cell.x), vec2(p.at.x * 2.0f + p.at.y, p.at.y * 2.0f - p.at.x),
                 vec2(p.slope.x * 2.0f + p.slope.y, p.slope.y * 2.0f - p.slope.x) * 0.4472136f, p.height);
}

// The next octave, finer by the square root of 10 and turned by 18.4 degrees: matrix (3 1; -1 3).
Place finer10(Place p) {
  return carried(uvec2(p.cell.x * 3u + p.cell.y, p.cell.y * 3u - p.cell.x), vec2(p.at.x * 3.0f + p.at.y, p.at.y * 3.0f - p.at.x),
                 vec2(p.slope.x * 3.0f + p.slope.y, p.slope.y * 3.0f - p.slope.x) * 0.3162278f, p.height);
}

// The next octave, finer by the square root of 17 and turned by 14.0 degrees: matrix (4 1; -1 4). Where its sums exceed 4 they
// need one bit more than a float has and round it off, 2^-22 of the square: for the smallest octaves only.
Place finer17(Place p) {
  return carried(uvec2(p.cell.x * 4u + p.cell.y, p.cell.y * 4u - p.cell.x), vec2(p.at.x * 4.0f + p.at.y, p.at.y * 4.0f - p.at.x),
                 vec2(p.slope.x * 4.0f + p.slope.y, p.slope.y * 4.0f - p.slope.x) * 0.2425356f, p.height);
}

// How much of an octave is left when a sample stands for `footprint` metres: all of it (exactly 1) up to half its wavelength, nothing
// from the wavelength on.
float octaveWeight(float wavelength, float footprint) {
  float t = min(max(wavelength / max(footprint, 0.000001f) - 1.0f, 0.0f), 1.0f);
  return t * t * (3.0f - 2.0f * t);
}

// A well mixed number from a seed (Mueller's integer hash).
uint mixedSeed(uint seed) {
  uint h = seed;
  h = (h ^ (h >> 16u)) * 0x45d9f3bu;
  h = (h ^ (h >> 16u)) * 0x45d9f3bu;
  return h ^ (h >> 16u);
}

// The hashes of a square's four corners; their upper bits are the good ones. `salt` tells octaves, purposes and seeds apart.
struct Corners {
  uint h00;
  uint h10;
  uint h01;
  uint h11;
};

uint cornerHash(uint x, uint z) {
  uint h = x + z;
  return (h ^ (h >> 15u)) * 0x2c1b3c6du;
}

Corners cornersOf(uvec2 cell, uint salt) {
  uint x0 = cell.x * 0x9e3779b1u;
  uint x1 = x0 + 0x9e3779b1u;
  uint z0 = cell.y * 0x85ebca77u;
  uint z1 = z0 + 0x85ebca77u;
  x0 = x0 ^ (x0 >> 15u);
  x1 = x1 ^ (x1 >> 15u);
  z0 = (z0 ^ (z0 >> 16u)) + salt;
  z1 = (z1 ^ (z1 >> 16u)) + salt;
  Corners c;
  c.h00 = cornerHash(x0, z0);
  c.h10 = cornerHash(x1, z0);
  c.h01 = cornerHash(x0, z1);
  c.h11 = cornerHash(x1, z1);
  return c;
}

// The upper 24 bits as a number in [-1, 1) or [0, 1); exact.
float signedUnit(uint h) { return float(int(h) >> 8) * 0.00000011920928955078125f; }
float unsignedUnit(uint h) { return float(int(h >> 8u)) * 0.000000059604644775390625f; }

// Quintic blend and its derivative (Perlin 2002).
float blend(float t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }
float blendSlope(float t) { return t * t * (t * (t * 30.0f - 60.0f) + 30.0f); }

// Value noise in [-1, 1] and its gradient a lattice unit: (value, d/dx, d/dz).
vec3 valueNoise(uvec2 cell, vec2 at, uint salt) {
  Corners h = cornersOf(cell, salt);
  float a = signedUnit(h.h00);
  float b = signedUnit(h.h10);
  float c = signedUnit(h.h01);
  float d = signedUnit(h.h11);
  float u = blend(at.x);
  float v = blend(at.y);
  float ab = b - a;
  float ac = c - a;
  float abcd = a - b - c + d;
  return vec3(a + ab * u + (ac + abcd * u) * v, (ab + abcd * v) * blendSlope(at.x), (ac + abcd * u) * blendSlope(at.y));
}

// Value noise in [-1, 1] without its gradient, for the many small octaves: cubic blend, half the work.
float plainNoise(uvec2 cell, vec2 at, uint salt) {
  Corners h = cornersOf(cell, salt);
  float a = float(int(h.h00) >> 8);
  float b = float(int(h.h10) >> 8);
  float c = float(int(h.h01) >> 8);
  float d = float(int(h.h11) >> 8);
  float u = at.x * at.x * (3.0f - 2.0f * at.x);
  float v = at.y * at.y * (3.0f - 2.0f * at.y);
  float low = a + (b - a) * u;
  float high = c + (d - c) * u;
  return (low + (high - low) * v) * 0.00000011920928955078125f;
}

// Gradient noise, about [-0.7, 0.7], and its gradient a lattice unit: (value, d/dx, d/dz).
vec3 gradientNoise(uvec2 cell, vec2 at, uint salt) {
  Corners h = cornersOf(cell, salt);
  // Two signed numbers from each hash, of its upper 16 bits and of the 16 from bit 12 up; exact.
  float ax = float(int(h.h00) >> 16);
  float az = float(int(h.h00 << 12u) >> 16);
  float bx = float(int(h.h10) >> 16);
  float bz = float(int(h.h10 << 12u) >> 16);
  float cx = float(int(h.h01) >> 16);
  float cz = float(int(h.h01 << 12u) >> 16);
  float dx = float(int(h.h11) >> 16);
  float dz = float(int(h.h11 << 12u) >> 16);
  float x1 = at.x - 1.0f;
  float z1 = at.y - 1.0f;
  float a = held(ax * at.x + az * at.y);
  float b = held(bx * x1 + bz * at.y);
  float c = held(cx * at.x + cz * z1);
  float d = held(dx * x1 + dz * z1);
  float u = blend(at.x);
  float v = blend(at.y);
  float low = a + (b - a) * u;
  float high = c + (d - c) * u;
  float lowX = ax + (bx - ax) * u;
  float highX = cx + (dx - cx) * u;
  float lowZ = az + (bz - az) * u;
  float highZ = cz + (dz - cz) * u;
  float acrossX = (b - a) + ((d - c) - (b - a)) * v;
  return vec3(low + (high - low) * v, lowX + (highX - lowX) * v + acrossX * blendSlope(at.x),
              lowZ + (highZ - lowZ) * v + (high - low) * blendSlope(at.y)) * 0.000030517578125f;
}

// A wave of unit period made of parabolas, 8 t (1 - 2 |t|) at t in [-1/2, 1/2], at most 6 % off the sine. Only its shape matters, and it
// is rounded alike everywhere.
float wave(float turns) {
  float t = turns - floor(turns) - 0.5f;
  return t * (16.0f * abs(t) - 8.0f);
}

// About 1 / sqrt(v), v > 0: the classic guess from the bits and one step of Newton's. Within 0.2 %, continuous, and, unlike the
// built-in functions of graphics drivers, the same bits everywhere.
float inverseRoot(float v) {
  float guess = uintBitsToFloat(0x5f375a86u - (floatBitsToUint(v) >> 1u));
  return held(guess * (3.0f - v * guess * guess)) * 0.5f;
}

// Stripes across `side` (turns a lattice unit, perpendicular to the stripes; may change from place to place): (height, its change a
// turn), the height about [-1, 1]. Every corner of the square has stripes of its own phase, and the blend is drawn towards full
// strength, so that stripes join and fork where phases disagree: with `side` across the slope, that is how water cuts a face (after
// the erosion filters of Clay John and Rune Skovbo Johansen).
vec2 stripes(uvec2 cell, vec2 at, vec2 side, uint salt) {
  Corners h = cornersOf(cell, salt);
  float phase = held(at.x * side.x + at.y * side.y);
  float a = unsignedUnit(h.h00) + phase;
  float b = unsignedUnit(h.h10) + (phase - side.x);
  float c = unsignedUnit(h.h01) + (phase - side.y);
  float d = unsignedUnit(h.h11) + (phase - side.x - side.y);
  a = a - floor(a) - 0.5f;
  b = b - floor(b) - 0.5f;
  c = c - floor(c) - 0.5f;
  d = d - floor(d) - 0.5f;
  float u = blend(at.x);
  float v = blend(at.y);
  float un = 1.0f - u;
  float vn = 1.0f - v;
  float wa = held(un * vn);
  float wb = held(u * vn);
  float wc = held(un * v);
  float wd = held(u * v);
  // Crests of |t|, sharp above and below; the parabola a quarter of a turn away measures how much the corners agree.
  float aa = abs(a);
  float ab = abs(b);
  float ac = abs(c);
  float ad = abs(d);
  float crest = held(4.0f * (wa * aa + wb * ab + wc * ac + wd * ad) - 1.0f);
  float sine = wa * (a * (1.0f - 2.0f * aa)) + wb * (b * (1.0f - 2.0f * ab)) + wc * (c * (1.0f - 2.0f * ac)) + wd * (d * (1.0f - 2.0f * ad));
  sine = held(8.0f * sine);
  float strength = inverseRoot(held(sine * sine + crest * crest) + 0.04f);
  return vec2(crest * strength, 4.0f * sine * strength);
}
