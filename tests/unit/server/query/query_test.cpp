#include "server/query/query.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <charconv>
#include <random>

#include "common/ground/ground.h"
#include "server/http/queries.h"
#include "server/scheduling/pool.h"
#include "tests/support/leaf_meshes.h"

namespace ridgecast::query {
namespace {

using lattice::Step;
using testing::HasSubstr;

wire::Answer answer(std::shared_ptr<const terrain::Terrain> terrain, const wire::Query& query) {
  Answering answering(std::move(terrain), query);
  while (!answering.isDone()) answering.work();
  return answering.take();
}

TEST(Query, AnswersWhatTheTerrainSays) {
  const auto terrain = terrain::create("canyon", 5).value();
  wire::Query q;
  q.id = 9;
  std::mt19937_64 random(1);
  for (int k = 0; k < 3000; ++k) {
    q.x.push_back(support::between(random, -1 << 30, 1 << 30));
    q.z.push_back(support::between(random, -1 << 30, 1 << 30));
  }
  const auto heights = answer(terrain, q);
  EXPECT_EQ(heights.id, 9u);
  ASSERT_EQ(heights.heights.size(), q.x.size());
  for (std::size_t k = 0; k < q.x.size(); k += 97) {
    float one = 0;
    terrain->heights({&q.x[k], 1}, {&q.z[k], 1}, {&one, 1});
    EXPECT_EQ(heights.heights[k], one);
  }
  q.kind = wire::QueryKind::kNormals;
  EXPECT_EQ(answer(terrain, q).normals.size(), 3 * q.x.size());
  wire::Query rays;
  rays.kind = wire::QueryKind::kRays;
  rays.rays = {{0, 0, 5000, 0, -1, 0, 1e5}, {0, 0, 5000, 0, 1, 0, 10}};
  const auto distances = answer(terrain, rays).distances;
  EXPECT_NEAR(distances[0], 5000 - terrain->height({0, 0}), 0.01);
  EXPECT_EQ(distances[1], -1);
}

// The bound holds on samples that its own grid has not seen, and is not absurdly far from the truth.
TEST(Query, DeviationBoundsADenseSample) {
  std::mt19937_64 random(2);
  for (const auto& description : terrain::builtIn()) {
    const auto terrain = terrain::create(description.name, 3).value();
    std::size_t beyond = 0, samples = 0;
    for (const int level : {0, 0, 1, 2, 4}) {
      // The terrain's own heights on a coarse grid: what a mesh looks like before it is refined.
      mesh::LeafMesh leaf;
      leaf.address = {level, support::between(random, -100, 100), support::between(random, -100, 100)};
      const int n = 12;
      for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
          const auto x = static_cast<std::int32_t>(leaf.address.side() * i / n), z = static_cast<std::int32_t>(leaf.address.side() * j / n);
          leaf.vertices.push_back({x, z, terrain->heightStep({leaf.address.x() + x, leaf.address.z() + z})});
        }
      const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (n + 1) + i); };
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          leaf.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
          leaf.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
        }
      mesh::canonicalize(leaf);
      const double bound = deviation(*terrain, leaf);
      double most = 0;
      for (const mesh::Triangle& t : leaf.triangles)
        for (int k = 0; k < 100; ++k) {
          double u = static_cast<double>(random() >> 11) * 0x1p-53, v = static_cast<double>(random() >> 11) * 0x1p-53;
          if (u + v > 1) u = 1 - u, v = 1 - v;
          const auto &a = leaf.vertices[t[0]], &b = leaf.vertices[t[1]], &c = leaf.vertices[t[2]];
          const auto x = static_cast<Step>(a.x + u * (b.x - a.x) + v * (c.x - a.x)),
                     z = static_cast<Step>(a.z + u * (b.z - a.z) + v * (c.z - a.z));
          const double area = static_cast<double>(support::doubledArea(a, b, c));
          const mesh::LocalVertex p{static_cast<std::int32_t>(x), static_cast<std::int32_t>(z), 0};
          const double height =
              (static_cast<double>(support::doubledArea(b, c, p)) * a.y + static_cast<double>(support::doubledArea(c, a, p)) * b.y +
               static_cast<double>(support::doubledArea(a, b, p)) * c.y) /
              area / 256;
          float truth = 0;
          const Step worldX = leaf.address.x() + x, worldZ = leaf.address.z() + z;
          terrain->heights({&worldX, 1}, {&worldZ, 1}, {&truth, 1});
          const double off = std::abs(truth - height);
          most = std::max(most, off);
          beyond += off > bound;
          ++samples;
        }
      EXPECT_LE(bound, 3 * most + 0.1) << description.name << " level " << level;
    }
    EXPECT_EQ(beyond, 0u) << description.name << ": of " << samples;
  }
  EXPECT_EQ(deviation(*terrain::create("alpine", 1).value(), {{0, 0, 0}, {}, {}}), 0);
}

class QueryHttpTest : public testing::Test {
 protected:
  QueryHttpTest() {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_shared<session::Directory>(resources, terrain);
    directory->add("other", terrain::create("alpine", 4).value()).value();
  }
  http::Answer get(const std::string& target, std::string_view method = "GET") {
    http::Request request;
    request.method = method;
    request.target = target;
    auto a = http::queryRoute(directory)(request);
    if (!a) {
      http::Answer none;
      none.status = 0;
      return none;
    }
    return a->later ? a->later->work({}) : *a;
  }
  std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 3).value();
  scheduling::Executor executor{1};
  std::shared_ptr<session::Directory> directory;
};

TEST_F(QueryHttpTest, HeightsAreExact) {
  const auto a = get("/v1/heights?at=10,20.5&at=-1e6,1234567.25&at=4e12,-4e12");
  EXPECT_EQ(a.status, 200u);
  EXPECT_EQ(a.type, "application/json");
  const std::vector<Step> x{2560, -256'000'000, 1'024'000'000'000'000}, z{5248, 316'049'216, -1'024'000'000'000'000};
  std::vector<float> expected(3);
  terrain->heights(x, z, expected);
  const char* at = a.body.data() + a.body.find('[') + 1;
  for (const float e : expected) {
    float value = 0;
    at = std::from_chars(at, a.body.data() + a.body.size(), value).ptr + 2;
    EXPECT_EQ(value, e) << a.body;
  }
  EXPECT_NE(get("/v1/heights?at=1,2&session=other").body, get("/v1/heights?at=1,2").body);
}

TEST_F(QueryHttpTest, NormalsAndRays) {
  EXPECT_THAT(get("/v1/normals?at=1,2&at=3,4").body, testing::StartsWith("{\"normals\": [["));
  EXPECT_NE(get("/v1/normals?at=1,2&spacing=10").body, get("/v1/normals?at=1,2").body);
  const auto rays = get("/v1/rays?ray=0,9000,0,0,-1,0&ray=0,9000,0,0,1,0&reach=20000");
  EXPECT_THAT(rays.body, testing::StartsWith("{\"rays\": [{\"distance\": "));
  EXPECT_THAT(rays.body, HasSubstr("}, null]}"));
}

TEST_F(QueryHttpTest, SaysWhatIsWrong) {
  std::string many = "/v1/heights?at=1,2";
  for (std::size_t k = 0; k < http::kMaxHttpPlaces; ++k) many += "&at=1,2";
  for (const std::string& wrong :
       {std::string("/v1/heights"), many, std::string("/v1/heights?at=1"), std::string("/v1/heights?at=1,2,3"),
        std::string("/v1/heights?at=1,nan"), std::string("/v1/heights?at=5e12,0"), std::string("/v1/heights?at=1,%zz"),
        std::string("/v1/heights?at=1,2;3,4"), std::string("/v1/normals?at=1,2&spacing=0"), std::string("/v1/normals?at=1,2&spacing=300"),
        std::string("/v1/rays?ray=1,2,3,0,0,0"), std::string("/v1/rays?ray=1,2,3,4,5"), std::string("/v1/rays?ray=0,0,0,1,1,1&reach=1e9"),
        std::string("/v1/rays?ray=0,1e7,0,1,1,1")}) {
    const auto a = get(wrong);
    EXPECT_EQ(a.status, 400u) << wrong.substr(0, 60);
    EXPECT_THAT(a.body, testing::EndsWith(".\n"));
  }
  EXPECT_EQ(get("/v1/heights?at=1,2&session=none").status, 404u);
  EXPECT_EQ(get("/v1/heights?at=1,2", "POST").status, 405u);
  EXPECT_EQ(get("/v1/elsewhere").status, 0u);
}

}  // namespace
}  // namespace ridgecast::query
