// A guess is the height of the least-squares plane, by another way to compute it, wherever there is one.
#include "common/points/guess.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/leaf_meshes.h"

namespace ridgecast::points {
namespace {

using support::between;
using support::Random;
using triangulation::Vertex;

class Nowhere : public triangulation::Partition {
 public:
  triangulation::RegionId regionAt(triangulation::Point2) const override { return triangulation::kOutside; }
};

struct Mesh {
  Mesh() : mesh(5000, nowhere) { all.allowAll(); }
  void add(const Vertex& v) {
    if (corners.size() < 3) {
      corners.push_back(v);
      if (corners.size() == 3) mesh.start(corners[0], corners[1], corners[2]);
    } else {
      mesh.insert(v, mesh.locate(v.point(), mesh.anyTriangle(), all), all);
    }
  }
  Nowhere nowhere;
  triangulation::Triangulation mesh;
  triangulation::WriteSet all;
  std::vector<Vertex> corners;
};

template <class F>
void forEachVertex(const triangulation::Triangulation& mesh, F&& f) {
  mesh.vertexPages().forEach(triangulation::kOutside, [&](triangulation::VertexId v) {
    if (v != triangulation::kInfinite) f(v);
  });
}

// Normal equations in long double, by elimination with pivots.
long double planeAt(const std::vector<Vertex>& ring, const Vertex& at) {
  long double m[3][4] = {};
  for (const Vertex& u : ring) {
    const long double row[4] = {1, static_cast<long double>(u.x) - at.x, static_cast<long double>(u.z) - at.z,
                                static_cast<long double>(u.y)};
    const long double w = 1 / (row[1] * row[1] + row[2] * row[2]);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 4; ++j) m[i][j] += w * row[i] * row[j];
  }
  for (int i = 0; i < 3; ++i) {
    int best = i;
    for (int r = i + 1; r < 3; ++r)
      if (std::abs(m[r][i]) > std::abs(m[best][i])) best = r;
    std::swap(m[i], m[best]);
    for (int r = 0; r < 3; ++r)
      for (int j = 3; r != i && j >= i; --j) m[r][j] -= m[i][j] * (m[r][i] / m[i][i]);
  }
  return m[0][3] / m[0][0];
}

TEST(Guess, IsThePlaneThatFitsTheNeighboursBest) {
  Random random(1);
  Mesh m;
  for (int k = 0; k < 1500; ++k)
    m.add({static_cast<std::int32_t>(between(random, -100'000, 100'000)), static_cast<std::int32_t>(between(random, -100'000, 100'000)),
           static_cast<std::int32_t>(between(random, -50'000, 500'000)), triangulation::kNoEdge});
  Guesser guesser;
  int sure = 0;
  forEachVertex(m.mesh, [&](triangulation::VertexId v) {
    const auto isKnown = [](triangulation::VertexId u) { return u % 7 != 0; };
    std::vector<Vertex> ring;
    m.mesh.forEachAround(v, [&](triangulation::HalfEdge h) {
      const triangulation::VertexId u = m.mesh.origin(triangulation::Triangulation::next(h));
      if (u != triangulation::kInfinite && isKnown(u)) ring.push_back(m.mesh.vertex(u));
    });
    const Guess guess = guesser.guess(m.mesh, v, isKnown);
    if (!guess.isSure) return;
    ++sure;
    EXPECT_GE(ring.size(), 3u);
    EXPECT_NEAR(guess.y, static_cast<double>(std::floor(planeAt(ring, m.mesh.vertex(v)))), 1.0);
  });
  EXPECT_GT(sure, 1300);
}

TEST(Guess, OnAPlaneIsThePlane) {
  Random random(2);
  Mesh m;
  for (int k = 0; k < 500; ++k) {
    const auto x = static_cast<std::int32_t>(between(random, -30'000'000, 30'000'000)),
               z = static_cast<std::int32_t>(between(random, -30'000'000, 30'000'000));
    m.add({x, z, x / 4 - z / 8 + 5, triangulation::kNoEdge});
  }
  Guesser guesser;
  forEachVertex(m.mesh, [&](triangulation::VertexId v) {
    const Guess guess = guesser.guess(m.mesh, v, [](triangulation::VertexId) { return true; });
    if (guess.isSure) {
      EXPECT_NEAR(guess.y, m.mesh.vertex(v).y, 3);
    }
  });
}

TEST(Guess, WithFewOrNoNeighboursIsTheirMeanOrTheLast) {
  Mesh m;
  for (const auto& [x, z, y] : {std::array{0, 0, 100}, {1000, 0, 200}, {0, 1000, 300}, {500, 100, 0}})
    m.add({x, z, y, triangulation::kNoEdge});
  Guesser guesser;
  forEachVertex(m.mesh, [&](triangulation::VertexId v) {
    if (m.mesh.vertex(v).x != 500) return;
    const auto isAt = [&](std::int32_t x, std::int32_t z) {
      return [&m, x, z](triangulation::VertexId u) { return m.mesh.vertex(u).x == x && m.mesh.vertex(u).z == z; };
    };
    EXPECT_EQ(guesser.guess(m.mesh, v, isAt(1000, 0)).y, 200);
    EXPECT_EQ(guesser.guess(m.mesh, v, [](triangulation::VertexId) { return false; }).y, 200) << "the last";
    EXPECT_FALSE(guesser.guess(m.mesh, v, isAt(0, 0)).isSure);
    EXPECT_EQ(guesser.guess(m.mesh, v, [&](triangulation::VertexId u) { return m.mesh.vertex(u).z == 0; }).y, 150) << "the mean";
  });
}

}  // namespace
}  // namespace ridgecast::points
