// Six flights in lock-step over real sockets, against a recording of every iteration: the hash of the mesh and a digest of all that the
// stream said of it.
// A change that is not meant to move a vertex or a byte moves none. One that is meant to records anew:
//   RIDGECAST_RECORD_FLIGHTS=1 build/test/bin/integration_recorded_flights
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/directory/directory.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "tests/support/flier.h"
#include "tests/support/sanitized.h"

namespace ridgecast {
namespace {

const std::string kRecording = RIDGECAST_CASES "/flights.txt";
const std::string kPaths = RIDGECAST_PATHS;

class Digest {
 public:
  void add(std::uint64_t v) { sum_ = lattice::mix(sum_ ^ v); }
  void add(lattice::LeafAddress a) {
    add(static_cast<std::uint64_t>(a.level));
    add(static_cast<std::uint64_t>(a.i));
    add(static_cast<std::uint64_t>(a.j));
  }
  void add(const std::vector<std::uint8_t>& bytes) {
    add(bytes.size());
    for (const std::uint8_t b : bytes) add(b);
  }
  std::uint64_t sum() const { return sum_; }

 private:
  std::uint64_t sum_ = 0;
};

// Everything but times.
std::uint64_t digestOf(const wire::Iteration& iteration) {
  Digest d;
  d.add(iteration.number);
  d.add(iteration.poseSequence);
  for (const auto& leaf : iteration.gone) d.add(leaf);
  for (const auto& leaf : iteration.whole) d.add(leaf.address), d.add(leaf.vertices), d.add(leaf.triangles), d.add(leaf.payload);
  for (const auto& leaf : iteration.come) d.add(leaf);
  d.add(iteration.points);
  d.add(iteration.settled);
  for (const std::uint64_t figure : {iteration.figures.leaves, iteration.figures.visibleLeaves, iteration.figures.triangles,
                                     iteration.figures.inserted, iteration.figures.removed})
    d.add(figure);
  return d.sum();
}

struct Flown {
  std::uint64_t hash, digest;
  friend bool operator==(const Flown&, const Flown&) = default;
};
using Flight = std::vector<Flown>;

Flight fly(const std::string& path, double perIteration, int iterations,
           const std::function<void(testing_support::Flier&, int)>& before = {}) {
  scheduling::Executor executor(2);
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->makeMesh = session::pipelineMeshes();
  resources->serverName = "recorded";
  const auto keyframes = camera::readPath(kPaths + "/" + path).value();
  auto directory = std::make_shared<directory::Directory>(resources, terrain::create(keyframes.terrain, keyframes.seed).value());
  net::Settings settings;
  settings.port = 0;
  auto server = net::Server::listen(settings, directory).value();
  Flight flight;
  {
    testing_support::Flier flier("ws://127.0.0.1:" + std::to_string(server->port()) + "/v1/stream", {});
    const testing_support::PathCamera camera(kPaths + "/" + path, flier.world());
    for (int n = 0; n < iterations; ++n) {
      if (before) before(flier, n);
      const auto iteration = flier.step(camera.at(n * perIteration));
      flight.push_back({iteration.meshHash, digestOf(iteration)});
    }
  }
  server->shutdown();
  return flight;
}

// The way there and back, other settings every few iterations, a rest at the end.
void changeSettings(testing_support::Flier& flier, int n) {
  wire::Settings settings;
  switch (n) {
    case 10:
      settings.threshold = 3;
      break;
    case 20:
      settings.threshold = 1;
      settings.triangleBudget = 30'000;
      break;
    case 35:
      settings.metric = wire::Metric::kArea;
      break;
    case 45:
      settings.metric = wire::Metric::kThesis;
      break;
    default:
      return;
  }
  flier.connection().change(settings);
}

std::map<std::string, Flight> recorded() {
  std::map<std::string, Flight> flights;
  std::ifstream in(kRecording);
  std::string name;
  Flown flown{};
  while (in >> name >> std::hex >> flown.hash >> flown.digest) flights[name].push_back(flown);
  return flights;
}

TEST(RecordedFlights, EveryIterationIsTheOneThatWasRecorded) {
  logging::setUp(logging::Format::kText, logging::Level::kWarning);
  constexpr int kMax = testing_support::kSanitized ? 22 : 60;  // the beginning shows what another compiler makes otherwise
  const std::map<std::string, Flight> flown = {
      {"alpine", fly("alpine.json", 0.1, kMax)},
      {"canyon", fly("canyon.json", 0.1, kMax)},
      {"archipelago", fly("archipelago.json", 0.1, kMax)},
      {"far", fly("alpine-1e12.json", 0.1, kMax)},
      {"return", fly("alpine-return.json", 1, std::min(40, kMax))},
      {"settings", fly("alpine.json", 0.1, kMax, changeSettings)},
  };
  if (std::getenv("RIDGECAST_RECORD_FLIGHTS")) {
    std::ofstream out(kRecording);
    for (const auto& [name, flight] : flown)
      for (const Flown& f : flight) out << name << std::hex << ' ' << f.hash << ' ' << f.digest << '\n';
    GTEST_SKIP() << "recorded anew: " << kRecording;
  }
  const auto expected = recorded();
  for (const auto& [name, flight] : flown) {
    ASSERT_TRUE(expected.contains(name)) << kRecording << " has no flight " << name;
    const Flight& then = expected.at(name);
    ASSERT_EQ(flight.size(), std::min<std::size_t>(then.size(), kMax)) << name;
    for (std::size_t n = 0; n < flight.size(); ++n) {
      ASSERT_EQ(flight[n].hash, then[n].hash) << name << ", iteration " << n << ": another mesh";
      ASSERT_EQ(flight[n].digest, then[n].digest) << name << ", iteration " << n << ": the same mesh, told otherwise";
    }
  }
}

}  // namespace
}  // namespace ridgecast
