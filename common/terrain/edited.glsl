// Edits on any terrain: its text stands before this between edited_before.glsl and here, raster_cubic.glsl and material_color.glsl after
// this. The ground is the terrain's own plus the bicubic of posts 0.5 m apart, in one addition, or the terrain's own alone where these are
// 0: bit for bit what edits::EditedTerrain computes.
#undef terrainHeight
#undef terrainColor
#undef rasterWeights
#undef rasterRow
#undef rasterCubic

// Posts are held in squares of 128 x 128. The table says of each square around the camera: 1 + which square of editsPosts it is; -1: it has
// no posts, one beside it has; 0: not even these have. A post is 16 x the steps that it is raised by, plus its material. A texel of level n
// stands for 2^n x 2^n posts: the mean of their rises, the most frequent of their materials.
uniform highp isampler2D editsTable, editsPosts;
uniform ivec2 editsCell;  // the cell in which the table begins
uniform int editsHeld;    // squares; 0: all ground is the terrain's own

float rasterCubic(ivec4 r0, ivec4 r1, ivec4 r2, ivec4 r3, vec2 t);
vec3 materialColor(int material);

int editsSquare(ivec2 square) {
  ivec2 side = textureSize(editsTable, 0);
  if (square.x < 0 || square.y < 0 || square.x >= side.x || square.y >= side.y) return 0;
  return texelFetch(editsTable, square, 0).x;
}

// Where a square's texels begin.
ivec2 editsOrigin(int square, int level) {
  int columns = textureSize(editsPosts, 0).x >> 7;
  return ivec2((square - 1) % columns, (square - 1) / columns) << (7 - level);
}

// A texel, counted from the table's beginning.
int editsTexel(ivec2 at, int level) {
  int bits = 7 - level;
  int square = editsSquare(at >> bits);
  return square > 0 ? texelFetch(editsPosts, editsOrigin(square, level) + (at & ((1 << bits) - 1)), level).x : 0;
}

// The surface through the posts; steps from the table's beginning.
float editsSmooth(ivec2 steps, int square) {
  ivec2 post = steps >> 7;
  ivec2 inside = post & 127;
  bool alone = square > 0 && min(inside.x, inside.y) > 0 && max(inside.x, inside.y) < 126;  // needs no other square
  ivec2 first = alone ? editsOrigin(square, 0) + inside - 1 : post - 1;
  ivec4 row[4];
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i)
      row[j][i] = (alone ? texelFetch(editsPosts, first + ivec2(i, j), 0).x : editsTexel(first + ivec2(i, j), 0)) >> 4;
  return rasterCubic(row[0], row[1], row[2], row[3], held(vec2(steps & 127) * 0.0078125f));
}

// What a sample of 2^level posts' width sees.
float editsMean(ivec2 steps, int level) {
  int bits = 7 + level;
  ivec2 from = steps - (((1 << bits) - 128) >> 1);  // a texel stands in the middle of its posts
  ivec2 at = from >> bits;
  vec2 t = vec2(from & ((1 << bits) - 1)) / float(1 << bits);
  vec4 four = vec4(editsTexel(at, level) >> 4, editsTexel(at + ivec2(1, 0), level) >> 4, editsTexel(at + ivec2(0, 1), level) >> 4,
                   editsTexel(at + 1, level) >> 4);
  vec2 rows = mix(four.xz, four.yw, t.x);
  return mix(rows.x, rows.y, t.y) * 0.00390625f;
}

float editsRise(ivec2 steps, float footprint) {
  int square = editsSquare(steps >> 14);
  if (square == 0) return 0.0f;
  float level = min(log2(max(footprint * 2.0f, 1.0f)), 7.0f);
  int finer = min(int(level), 6);
  float low = finer == 0 ? editsSmooth(steps, square) : editsMean(steps, finer);
  return level <= 0.0f ? low : mix(low, editsMean(steps, finer + 1), level - float(finer));
}

// Steps from the table's beginning; false: far from it.
bool editsReach(ivec2 cell, vec2 fraction, out ivec2 steps) {
  ivec2 from = cell - editsCell;
  steps = from * 1048576 + ivec2(floor(fraction * 1048576.0f));
  return editsHeld > 0 && min(from.x, from.y) >= 0 && max(from.x, from.y) < 1024;
}

float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  float own = ownTerrainHeight(cell, fraction, footprint, seed);
  ivec2 steps;
  if (!editsReach(cell, fraction, steps) || own <= -131072.0f) return own;  // that deep: a height map's unknown ground
  float rise = editsRise(steps, footprint);
  return rise == 0.0f ? own : held(own) + held(rise);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  ivec2 steps;
  if (editsReach(cell, fraction, steps)) {
    int level = int(min(log2(max(footprint * 2.0f, 1.0f)) + 0.5f, 7.0f));
    int material = editsTexel(((steps + 64) >> 7) >> level, level) & 15;  // of the nearest post
    if (material > 0) return materialColor(material);
  }
  return ownTerrainColor(cell, fraction, height, normal, footprint, seed);
}
