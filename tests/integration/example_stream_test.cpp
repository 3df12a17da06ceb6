// The recorded stream of proto/example decodes to the leaves that stand beside it. Records it again:
//   RIDGECAST_RECORD_EXAMPLE=1 build/test/bin/integration_example_stream
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <map>
#include <memory>
#include <ranges>
#include <sstream>
#include <string>
#include <utility>

#include "client/core/mesh/scene.h"
#include "client/link/connection.h"
#include "common/wire/wire.h"
#include "server/directory/directory.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

const std::string kFolder = RIDGECAST_EXAMPLE;

std::string contentOf(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Four bytes of length, little-endian, before each message.
std::string framed(const wire::ServerMessage& message) {
  const std::string bytes = wire::encode(message);
  std::string out;
  for (int k = 0; k < 4; ++k) out += static_cast<char>(bytes.size() >> (8 * k) & 255);
  return out + bytes;
}

// What a client holds after an iteration; the vertices and triangles of the leaves that it brought or changed.
void describe(const wire::Iteration& iteration, const core::Scene& scene, std::ostream& out) {
  out << std::dec << "iteration " << iteration.number << " leaves " << scene.leaves().size() << " triangles " << scene.triangles()
      << " hash " << std::hex << scene.hash() << '\n';
  for (const auto& a : iteration.gone) out << std::dec << "gone " << a.level << ' ' << a.i << ' ' << a.j << '\n';
  const auto leaf = [&](const char* how, const lattice::LeafAddress& a) {
    const core::HeldLeaf& held = scene.leaves().at(a);
    mesh::LeafMesh ordered = *held.mesh;
    mesh::canonicalize(ordered);
    out << how << std::dec << ' ' << a.level << ' ' << a.i << ' ' << a.j << " hash " << std::hex << held.hash << std::dec << '\n';
    for (const mesh::LocalVertex& v : ordered.vertices) out << "v " << v.x << ' ' << v.z << ' ' << v.y << '\n';
    for (const mesh::Triangle& t : ordered.triangles) out << "t " << t[0] << ' ' << t[1] << ' ' << t[2] << '\n';
  };
  for (const auto& whole : iteration.whole) leaf("whole", whole.address);
  const auto newest = std::ranges::max(scene.leaves() | std::views::values | std::views::transform(&core::HeldLeaf::version));
  for (const auto& [address, held] : scene.leaves())
    if (iteration.whole.empty() && held.version == newest)
      leaf(std::ranges::find(iteration.come, address) == iteration.come.end() ? "changed" : "come", address);
}

// Heights by place, of all vertices.
using Points = std::map<std::pair<lattice::Step, lattice::Step>, std::int32_t>;
Points pointsOf(const core::Scene& scene) {
  Points points;
  for (const auto& [address, held] : scene.leaves())
    for (const mesh::LocalVertex& v : held.mesh->vertices) points[{address.x() + v.x, address.z() + v.z}] = v.y;
  return points;
}

std::string record() {
  logging::setUp(logging::Format::kText, logging::Level::kWarning);
  scheduling::Executor executor(2);
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->makeMesh = session::pipelineMeshes();
  resources->serverName = "example";
  auto directory = std::make_shared<directory::Directory>(resources, terrain::create("canyon", 1).value());
  net::Settings settings;
  settings.port = 0;
  auto server = net::Server::listen(settings, directory).value();
  std::string stream;
  {
    wire::Hello hello;
    hello.pacing = wire::Pacing::kLockstep;
    hello.settings.threshold = 2.5;
    hello.points = true;
    const auto connection = link::Connection::open({"127.0.0.1", std::to_string(server->port()), "default"}, hello,
                                                   {.reconnects = false, .timeout = testing_support::kTimeout})
                                .value();
    wire::World world = connection->world();
    world.terrainSource.clear();  // long, and of no use here
    stream += framed(world);
    core::Scene scene;
    scene.follow({.points = true});
    std::uint64_t sequence = 0;
    const auto step = [&](const camera::Camera& camera) {
      connection->send({++sequence, camera});
      wire::Iteration iteration = connection->receive(testing_support::kTimeout).value().iteration;
      scene.apply(iteration).value();
      connection->acknowledge({iteration.number, scene.hash()});
      return iteration;
    };
    camera::Camera camera;
    camera.pose.y = 29'000;  // high up, for few leaves
    camera.pose.pitch = -1.2;
    while (!step(camera).settled) {
    }
    connection->resend({});  // the first of the stream brings everything
    for (std::uint64_t n = 1; n <= 4; ++n) {
      wire::Iteration iteration = step(camera);
      iteration.number = iteration.poseSequence = n;
      iteration.figures = {};
      stream += framed(iteration);
      camera.pose.z += (n < 3 ? -2500 : 12'000) * 256;
      if (n == 3) camera.pose.y -= 20'000;  // points go, and others are raised
    }
  }
  server->shutdown();
  return stream;
}

TEST(ExampleStream, DecodesToTheLeavesBesideIt) {
  const bool records = std::getenv("RIDGECAST_RECORD_EXAMPLE");
  std::string stream = records ? record() : contentOf(kFolder + "/stream.bin");
  if (records) std::ofstream(kFolder + "/stream.bin", std::ios::binary) << stream;
  core::Scene scene;
  scene.follow({.points = true});
  std::ostringstream leaves;
  std::size_t worlds = 0, iterations = 0, gone = 0, raised = 0, come = 0;
  Points points;
  for (std::size_t at = 0; at < stream.size();) {
    ASSERT_LE(at + 4, stream.size());
    std::size_t length = 0;
    for (int k = 3; k >= 0; --k) length = length << 8 | static_cast<unsigned char>(stream[at + static_cast<std::size_t>(k)]);
    ASSERT_LE(at + 4 + length, stream.size());
    const auto message = wire::decodeServer({reinterpret_cast<const std::uint8_t*>(stream.data()) + at + 4, length});
    ASSERT_TRUE(message) << message.error().message;
    at += 4 + length;
    if (const auto* iteration = std::get_if<wire::Iteration>(&*message)) {
      ++iterations;
      const auto applied = scene.apply(*iteration);
      ASSERT_TRUE(applied) << applied.error().message;
      EXPECT_FALSE(scene.lost());
      EXPECT_EQ(scene.hash(), iteration->meshHash);
      describe(*iteration, scene, leaves);
      const Points before = std::exchange(points, pointsOf(scene));
      if (!iteration->whole.empty()) continue;
      for (const auto& [place, y] : before) {
        const auto now = points.find(place);
        gone += now == points.end();
        raised += now != points.end() && now->second != y;
      }
      for (const auto& [place, y] : points) come += !before.contains(place);
    } else {
      worlds += std::holds_alternative<wire::World>(*message);
    }
  }
  if (records) std::ofstream(kFolder + "/leaves.txt") << leaves.str();
  EXPECT_EQ(worlds, 1u);
  EXPECT_EQ(iterations, 4u);
  EXPECT_GT(gone, 0u);
  EXPECT_GT(raised, 0u);
  EXPECT_GT(come, 0u);
  if (records) std::cout << gone << " points go, " << raised << " are raised, " << come << " come\n";
  EXPECT_TRUE(leaves.str() == contentOf(kFolder + "/leaves.txt")) << "the leaves are others than leaves.txt says";
}

}  // namespace
}  // namespace ridgecast
