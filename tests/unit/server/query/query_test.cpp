#include "server/query/query.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "common/ground/ground.h"
#include "common/text/text.h"
#include "server/http/queries.h"
#include "server/scheduling/pool.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/replies.h"
#include "tests/support/sanitized.h"

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
  q.kind = wire::QueryKind::kMaterials;
  std::vector<std::uint8_t> materials(q.x.size());
  terrain->materials(q.x, q.z, materials);
  EXPECT_EQ(answer(terrain, q).materials, materials);
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

// Grass for x below 0, then mud, which is its own, and nothing that is said from 1 m on.
class Meadow final : public terrain::Terrain {
 public:
  std::string_view name() const override { return "meadow"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  std::span<const std::string> ownMaterials() const override { return own_; }
  void heights(std::span<const Step>, std::span<const Step>, std::span<float> out) const override { std::ranges::fill(out, 0.0f); }
  void materials(std::span<const Step> x, std::span<const Step>, std::span<std::uint8_t> out) const override {
    std::ranges::transform(x, out.begin(), [](Step v) { return static_cast<std::uint8_t>(v < 0 ? 5 : v < 256 ? 9 : 0); });
  }

 private:
  const std::vector<std::string> own_{"mud"};
};

class QueryHttpTest : public testing::Test {
 protected:
  QueryHttpTest() {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    resources->limits.maxSessionsPerClient = 2;
    resources->makeTerrain = [](const session::WorldSpec& spec, const std::stop_token&) {
      return terrain::create(spec.terrain, spec.seed + static_cast<std::uint32_t>(spec.parameters.size()));
    };
    directory = std::make_shared<directory::Directory>(resources, terrain);
    directory->add("other", terrain::create("alpine", 4).value()).value();
    directory->add("meadow", std::make_shared<Meadow>()).value();
  }
  http::Answer get(const std::string& target, std::string_view method = "GET") {
    http::Request request;
    request.method = method;
    request.target = target;
    return asked(request);
  }
  http::Answer post(const std::string& target, std::string body, std::string_view type) {
    http::Request request;
    request.method = "POST";
    request.target = target;
    request.contentType = type;
    request.client = "address 192.0.2.1";
    return asked(request, std::move(body));
  }
  http::Answer asked(const http::Request& request, std::string body = {}) {
    auto reply = http::queryRoute(directory)(request);
    if (!reply) return {.status = 0};
    const auto* later = std::get_if<http::DeferredResponse>(&*reply);
    const testing_support::Replied a = later && later->queue == http::Queue::kWorlds ? testing_support::replyOf(*later) : *reply;
    if (a.ofBody && body.size() > a.ofBody->maxBytes) return http::plain(413, a.ofBody->tooLong);
    turns = 0;
    return a.made({}, std::move(body), &turns);
  }
  int turns = 0;  // of the last answer
  std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 3).value();
  scheduling::Executor executor{1};
  std::shared_ptr<directory::Directory> directory;
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
  EXPECT_THAT(rays.headers, testing::Contains(std::pair<std::string, std::string>("Ridgecast-Known", "measured")));
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
  EXPECT_EQ(get("/v1/heights?at=1,2", "PUT").status, 405u);
  EXPECT_EQ(get("/v1/elsewhere").status, 0u);
}

constexpr char kDoubles[] = "application/octet-stream", kJson[] = "application/json";

template <class Number>
std::string bytesOf(const std::vector<Number>& list) {
  return {reinterpret_cast<const char*>(list.data()), list.size() * sizeof(Number)};
}

TEST_F(QueryHttpTest, MaterialsHaveNamesOrNumbers) {
  EXPECT_EQ(get("/v1/materials?session=meadow&at=-3,2&at=0.5,2&at=7,2").body, "{\"materials\": [\"grass\", \"mud\", null]}\n");
  EXPECT_EQ(post("/v1/materials?session=meadow", bytesOf(std::vector<double>{-3, 2, 0.5, 2, 7, 2}), kDoubles).body,
            std::string("\5\11\0", 3));
  EXPECT_THAT(get("/v1/materials?at=1,2").body, testing::MatchesRegex("\\{\"materials\": \\[\"[a-z]+\"\\]\\}\n"));
}

TEST_F(QueryHttpTest, APostedQueryIsAnsweredByTheTerrainsOwnBits) {
  constexpr std::size_t kCount = http::kMaxPosted;
  support::Random random(9);
  std::vector<double> places;
  std::vector<Step> x, z;
  for (std::size_t k = 0; k < kCount; ++k) {
    x.push_back(support::between(random, -100'000'000, 100'000'000));
    z.push_back(support::between(random, -100'000'000, 100'000'000));
    places.push_back(static_cast<double>(x.back()) / 256);
    places.push_back(static_cast<double>(z.back()) / 256);
  }
  std::vector<float> heights(kCount), normals(3 * kCount);
  terrain->heights(x, z, heights);
  terrain::normals(*terrain, x, z, 512, normals);
  const auto raw = post("/v1/heights", bytesOf(places), kDoubles);
  EXPECT_EQ(raw.status, 200u) << raw.body;
  EXPECT_EQ(raw.type, kDoubles);
  EXPECT_TRUE(raw.body == bytesOf(heights));
  EXPECT_GT(turns, 1);
  EXPECT_TRUE(post("/v1/normals?spacing=2", bytesOf(places), kDoubles).body == bytesOf(normals));
  EXPECT_NE(post("/v1/heights?session=other", bytesOf(places), kDoubles).body, raw.body);

  std::string text = "{\"at\": [";
  for (std::size_t k = 0; k < kCount; ++k)
    text += (k > 0 ? ",[" : "[") + text::rounded(places[2 * k], 17) + "," + text::rounded(places[2 * k + 1], 17) + "]";
  const auto told = post("/v1/heights", text + "]}", "Application/JSON; charset=utf-8");
  EXPECT_EQ(told.type, kJson);
  const auto read = nlohmann::json::parse(told.body)["heights"].get<std::vector<float>>();
  EXPECT_TRUE(read == heights);
  EXPECT_EQ(post("/v1/heights", text + ",[0,0]]}", kJson).status, 400u);
  EXPECT_EQ(post("/v1/heights", bytesOf(places) + std::string(16, 0), kDoubles).status, 413u);
  // As GET answers.
  EXPECT_EQ(post("/v1/normals", R"({"spacing": 10, "at": [[1, 2], [3.5e0, -4]]})", kJson).body,
            get("/v1/normals?at=1,2&at=3.5,-4&spacing=10").body);
  EXPECT_EQ(post("/v1/normals?spacing=10", R"({"at": [[1, 2]]})", kJson).body, get("/v1/normals?at=1,2&spacing=10").body);
}

TEST_F(QueryHttpTest, PostedRaysToo) {
  support::Random random(4);
  std::vector<double> numbers, expected;
  const auto uniform = [&](double low, double high) { return low + static_cast<double>(random() >> 11) * 0x1p-53 * (high - low); };
  for (int k = 0; k < testing_support::rounds(static_cast<int>(http::kMaxPosted)); ++k) {
    const auto x = support::between(random, -1'000'000, 1'000'000), z = support::between(random, -1'000'000, 1'000'000);
    const ground::Ray ray{x, z, uniform(0, 4000), uniform(-1, 1), uniform(-1, 0.1), uniform(-1, 1), 3000};
    numbers.insert(numbers.end(),
                   {static_cast<double>(x) / 256, ray.y, static_cast<double>(z) / 256, ray.directionX, ray.directionY, ray.directionZ});
    expected.push_back(ground::cast(*terrain, ray));
  }
  EXPECT_TRUE(post("/v1/rays?reach=3000", bytesOf(numbers), kDoubles).body == bytesOf(expected));
  EXPECT_GT(std::ranges::count_if(expected, [](double d) { return d > 0; }), 100);
  EXPECT_GT(std::ranges::count(expected, -1.0), 100);
  EXPECT_EQ(post("/v1/rays", R"({"rays": [[0, 9000, 0, 0, -1, 0], [0, 9000, 0, 0, 1, 0]], "reach": 20000})", kJson).body,
            get("/v1/rays?ray=0,9000,0,0,-1,0&ray=0,9000,0,0,1,0&reach=20000").body);
  EXPECT_EQ(post("/v1/rays", std::string(48 * (http::kMaxPosted + 1), 0), kDoubles).status, 413u);
}

TEST_F(QueryHttpTest, EveryBodyThatIsNoneIsRefusedInASentence) {
  const auto refused = [&](const std::string& target, const std::string& body, std::string_view type, unsigned status = 400) {
    const auto a = post(target, body, type);
    EXPECT_EQ(a.status, status) << body.substr(0, 80);
    EXPECT_THAT(a.body, testing::EndsWith(".\n"));
  };
  for (const char* type : {"", "text/plain", "application/jsonp", "application/x-www-form-urlencoded", "multipart/form-data"})
    refused("/v1/heights", R"({"at": [[1, 2]]})", type, 415);
  const std::string places = R"({"at": [[1, 2], [-3.5, 4e2]], "spacing": 1})", rays = R"({"rays": [[0,9,0,0,-1,0]], "reach": 5})";
  ASSERT_EQ(post("/v1/heights", places, kJson).status, 200u);
  ASSERT_EQ(post("/v1/rays", rays, kJson).status, 200u);
  for (std::size_t length = 0; length < places.size(); ++length) refused("/v1/heights", places.substr(0, length), kJson);
  for (std::size_t length = 0; length < rays.size(); ++length) refused("/v1/rays", rays.substr(0, length), kJson);
  for (const char* wrong : {"[]",
                            "{}",
                            "null",
                            R"({"at": []})",
                            R"({"at": [[]]})",
                            R"({"at": [[1]]})",
                            R"({"at": [[1, 2, 3]]})",
                            R"({"at": [1, 2]})",
                            R"({"at": [[1, "2"]]})",
                            R"({"at": [[1, null]]})",
                            R"({"at": [[1, [2]]]})",
                            R"({"at": [[1, {}]]})",
                            R"({"at": {"at": [[1, 2]]}})",
                            R"({"at": [[1, 2]], "at": [[1, 2]]})",
                            R"({"at": [[1, 2]], "session": "default"})",
                            R"({"at": [[1, 2]]} 1)",
                            R"({"at": [[1, 2],]})",
                            R"({"at": [[NaN, 2]]})",
                            R"({"at": [[1e999, 2]]})",
                            R"({"at": [[5e12, 2]]})",
                            R"({"at": [[1, 2]], "spacing": 0})",
                            R"({"at": [[1, 2]], "spacing": 1e300})",
                            R"({"at": [[1, 2]], "spacing": "1"})",
                            R"({"at": [[1, 2]], "spacing": [[1, 2]]})",
                            R"({"rays": [[1, 2]]})"})
    refused("/v1/normals", wrong, kJson);
  refused("/v1/heights", std::string(1'000'000, '['), kJson);
  refused("/v1/rays", R"({"rays": [[0,9,0,0,0,0]]})", kJson);
  refused("/v1/rays", R"({"rays": [[0,9,0,0,1,0]], "reach": -1})", kJson);

  const std::vector<double> two{1, 2, 3, 4};
  ASSERT_EQ(post("/v1/heights", bytesOf(two), kDoubles).status, 200u);
  for (std::size_t length = 0; length < 32; ++length)
    if (length != 16) refused("/v1/heights", bytesOf(two).substr(0, length), kDoubles);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinite = std::numeric_limits<double>::infinity();
  for (const double wrong : {kNan, kInfinite, -kInfinite, 5e12, -1e300}) {
    refused("/v1/heights", bytesOf(std::vector<double>{1, 2, wrong, 4}), kDoubles);
    EXPECT_THAT(post("/v1/heights", bytesOf(std::vector<double>{1, 2, 3, wrong}), kDoubles).body, HasSubstr("number 2 is not"));
    for (std::size_t k = 0; k < 6; ++k) {
      std::vector<double> ray{0, 9, 0, 0, -1, 0};
      ray[k] = wrong;
      refused("/v1/rays", bytesOf(ray), kDoubles);
    }
  }
  refused("/v1/heights?spacing=nan", bytesOf(two), kDoubles);
  refused("/v1/normals?spacing=0", bytesOf(two), kDoubles);
  refused("/v1/heights?session=none", bytesOf(two), kDoubles, 404);
}

TEST_F(QueryHttpTest, MakesASessionAsAStreamDoes) {
  const std::string world = "&session=race&terrain=canyon&seed=7";
  for (const char* wrong : {"/v1/heights?at=1", "/v1/rays?ray=0", "/v1/normals?at=1,2&spacing=0"})
    EXPECT_EQ(get(wrong + world).status, 400u);
  EXPECT_EQ(post("/v1/heights?" + world, "", "text/csv").status, 415u);
  EXPECT_FALSE(directory->find("race")) << "for no question no world is made";
  const auto made = get("/v1/heights?at=10,20&at=-3000,4" + world + "&clock=stepped");
  ASSERT_EQ(made.status, 200u) << made.body;
  const auto race = directory->find("race");
  ASSERT_TRUE(race);
  EXPECT_EQ(race->terrain()->name(), "canyon");
  EXPECT_EQ(race->terrain()->seed(), 7u);
  EXPECT_EQ(race->clock().state().mode, wire::ClockMode::kStepped);
  EXPECT_GT(race->uses(), 0u) << "it lives as long as any";
  EXPECT_EQ(get("/v1/heights?at=10,20&at=-3000,4&session=race").body, made.body);
  EXPECT_EQ(post("/v1/heights?" + world, R"({"at": [[10, 20], [-3000, 4]]})", kJson).body, made.body);
  const auto other = get("/v1/heights?at=10,20&session=race&seed=8");
  EXPECT_EQ(other.status, 409u);
  EXPECT_THAT(other.body, HasSubstr("is another world (terrain canyon, seed 7)"));
  const auto none = get("/v1/heights?at=10,20&session=none");
  EXPECT_EQ(none.status, 404u);
  EXPECT_THAT(none.body, HasSubstr("&terrain=NAME of /v1/stream creates one"));
  EXPECT_EQ(get("/v1/heights?at=10,20&session=new&terrain=atlantis").status, 400u);

  http::Request request;
  request.method = "GET";
  request.target = "/v1/heights?at=10,20&session=new&terrain=canyon";
  request.rights = access::Right::kQuery;
  const auto forbidden = asked(request);
  EXPECT_EQ(forbidden.status, 403u);
  EXPECT_THAT(forbidden.body, HasSubstr("lacks the right 'create'"));
  EXPECT_FALSE(directory->find("new"));
}

TEST_F(QueryHttpTest, WorldsThatTakeLongAreMadeByWork) {
  for (int k = 0; k < 2; ++k) {
    const std::string name = "slow" + std::to_string(k);
    http::Request request;
    request.method = "POST";
    request.contentType = kJson;
    request.client = "address 192.0.2.1";
    const std::string target = "/v1/heights?session=" + name + "&terrain=canyon&param=depth=5";
    request.target = target;
    {
      const testing_support::Replied first(*http::queryRoute(directory)(request));
      ASSERT_TRUE(first.later);
      EXPECT_EQ(first.later->queue, http::Queue::kPrompt) << "somebody else may have the name, or make it";
      const testing_support::Replied second(first.later->work({}));
      ASSERT_TRUE(second.later);
      EXPECT_EQ(second.later->queue, http::Queue::kWorlds);
      EXPECT_EQ(second.later->progress(), "preparing the terrain");
    }
    EXPECT_FALSE(directory->find(name)) << "its client has left";
    EXPECT_EQ(asked(request, R"({"at": [[1, 2]]})").status, 200u);
    EXPECT_TRUE(directory->find(name));
  }
  const auto third = post("/v1/heights?session=third&terrain=canyon", R"({"at": [[1, 2]]})", kJson);
  EXPECT_EQ(third.status, 429u);
  EXPECT_THAT(third.body, HasSubstr("has made 2 of the sessions that live here"));
}

TEST_F(QueryHttpTest, WhoAsksForMuchPaysFromItsBudget) {
  const std::vector<double> places(2 * http::kMaxPosted);
  const auto budgets = directory->find("default")->budgetsOf("address 192.0.2.1");
  const auto begin = std::chrono::steady_clock::now();
  for (int k = 0; k < 3; ++k) EXPECT_EQ(post("/v1/normals", bytesOf(places), kDoubles).status, 200u);
  // 1.2 million heights of 8 million a second, a quarter of a second of which was saved up.
  const auto paid = std::chrono::duration<double>(budgets->queries.free() - begin).count();
  EXPECT_GE(paid, 1'200'000.0 / session::kHeightsPerSecond - 0.2501);
  const auto now = std::chrono::steady_clock::now();
  budgets->queries.spend(now, session::kHeightsPerSecond);  // by other connections
  EXPECT_EQ(post("/v1/heights", bytesOf(std::vector<double>{1, 2}), kDoubles).status, 200u);
  EXPECT_GE(std::chrono::steady_clock::now() - now, std::chrono::milliseconds(740)) << "it waits for what the others have spent";
}

}  // namespace
}  // namespace ridgecast::query
