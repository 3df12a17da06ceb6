struct Row { float v[4000]; };
struct Page { Row a; Row b; Row c; Row d; Row e; Row f; Row g; Row h; };
struct Book { Page a; Page b; Page c; Page d; Page e; Page f; Page g; Page h; };
struct Shelf { Book a; Book b; Book c; Book d; Book e; Book f; Book g; Book h; };
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 1.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  Shelf shelf;
  int at = int(fraction.x * 3999.0);
  for (int k = 0; k < 4000; ++k) {
    shelf.a.a.a.v[k] = float(cell.x + k);
    shelf.h.h.h.v[k] = float(cell.y - k);
  }
  return vec3(shelf.a.a.a.v[at] * 0.000001 + shelf.h.h.h.v[at] * 0.000001);
}
