// What an iteration's changes cost, as points and as leaves sent whole: bytes on the wire, the server's time and the client's, along the
// flights of the evaluation. Every mesh is compared by its hash.
#include <algorithm>
#include <ctime>
#include <memory>
#include <stdexcept>

#include "client/core/mesh/scene.h"
#include "common/camera/path.h"
#include "common/codec/codec.h"
#include "common/terrain/terrain.h"
#include "common/wire/wire.h"
#include "server/encoding/encoder.h"
#include "server/pipeline/pipeline.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"
#include "tests/bench/bench.h"

namespace ridgecast::bench {
namespace {

// Of this thread, in seconds: other programs are not in it.
double processorTime() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// One client's stream, without a line: the server's bookkeeping and coding, the message, the client's mesh.
class Stream {
 public:
  Stream(std::shared_ptr<const terrain::Terrain> terrain, std::shared_ptr<scheduling::Pool> pool, bool points)
      : replica_(1, points), encoder_(std::move(terrain), std::move(pool), {points, false, false}) {
    scene_.follow({points, false, settings::kDefaultBudget});
  }

  struct Cost {
    double bytes = 0, server = 0, client = 0, made = 0;  // of the message; seconds of coding, of decoding, of that and making all leaves
  };
  Cost send(pipeline::Pipeline& pipeline) {
    Cost cost;
    wire::Iteration iteration;
    double began = processorTime();
    encoder_.encode(replica_.send(pipeline.leaves()), pipeline, iteration);
    cost.server = processorTime() - began;
    const std::string message = wire::encode(wire::ServerMessage(iteration));
    cost.bytes = static_cast<double>(message.size());
    began = processorTime();
    const auto applied = scene_.apply(iteration);
    cost.client = processorTime() - began;
    scene_.leaves();
    cost.made = processorTime() - began;
    if (!applied) throw std::runtime_error(applied.error().message);
    if (scene_.hash() != iteration.meshHash)
      throw std::runtime_error("iteration " + std::to_string(iteration.number) + ": the client holds another mesh");
    replica_.acknowledge(iteration.number, scene_.hash());
    return cost;
  }

 private:
  replica::Replica replica_;
  encoding::Encoder encoder_;
  core::Scene scene_;
};

struct Flown {
  double seconds = 0, changes = 0;                 // of path; vertices that came and went
  Stream::Cost points, whole;                      // sums
  std::vector<double> decode, made;                // seconds, of points, each iteration
  double begin = 0, beginWhole = 0, vertices = 0;  // bytes until the first pose is settled; vertices then
};

// From the settled first picture on.
Flown fly(const std::string& file, double most) {
  const auto path = camera::readPath(file);
  if (!path) throw std::runtime_error(path.error().message + " (--path FILE)");
  const auto made = terrain::create(path->terrain.empty() ? "alpine" : path->terrain, path->seed);
  if (!made) throw std::runtime_error(made.error().message);
  const std::shared_ptr<const terrain::Terrain>& terrain = *made;
  scheduling::Executor executor(1);
  pipeline::Pipeline pipeline(terrain, pipeline::grant({}, {}), executor.makePool());
  Stream points(terrain, executor.makePool(), true), whole(terrain, executor.makePool(), false);
  Flown f;
  f.seconds = std::min(path->duration(), most);
  const auto frame = [&](double t) {
    camera::Camera camera;
    camera.pose = camera::poseAt(*path, t, [&](lattice::Point p) { return terrain->height(p); });
    camera.projection.verticalFov = path->verticalFov;
    const settings::IterationStats figures = pipeline.iterate(camera);
    f.changes += figures.inserted + figures.removed;
    const auto add = [](Stream::Cost& sum, const Stream::Cost& cost) {
      sum = {sum.bytes + cost.bytes, sum.server + cost.server, sum.client + cost.client, sum.made + cost.made};
    };
    const Stream::Cost cost = points.send(pipeline);
    f.decode.push_back(cost.client);
    f.made.push_back(cost.made);
    add(f.points, cost);
    add(f.whole, whole.send(pipeline));
  };
  for (int k = 0; k < 60 && !pipeline.settled(); ++k) frame(0);
  f.begin = f.points.bytes;
  f.beginWhole = f.whole.bytes;
  f.vertices = f.changes;
  f.points = f.whole = {};
  f.changes = 0;
  f.decode.clear();
  f.made.clear();
  for (int n = 1; n <= static_cast<int>(f.seconds * 10); ++n) frame(n * 0.1);
  return f;
}

}  // namespace

Report deltas(const Options& options) {
  Report report;
  std::vector<std::pair<std::string, std::string>> files;
  for (const std::string name : {"alpine", "canyon", "archipelago", "alpine-return"})
    files.emplace_back(name, RIDGECAST_PATHS "/" + name + ".json");
  for (std::size_t n = 0; n + 1 < options.arguments.size(); ++n)
    if (options.arguments[n] == "--path") files = {{"alpine", options.arguments[n + 1]}};
  for (const auto& [name, file] : files) {
    progress(name);
    const Flown f = fly(file, options.quick ? 4 : 1e9);
    const std::string of = name == "alpine" ? "" : name + "_";
    report.add(of + "bytes_per_second", f.points.bytes / f.seconds, "B/s");
    report.add(of + "whole_bytes_per_second", f.whole.bytes / f.seconds, "B/s");
    report.add(of + "bytes_per_change", f.points.bytes / f.changes, "B");
    report.add(of + "begin_bytes_per_vertex", f.begin / f.vertices, "B");
    report.add(of + "whole_begin_bytes_per_vertex", f.beginWhole / f.vertices, "B");
    report.add(of + "server_us_per_change", 1e6 * f.points.server / f.changes, "us");
    report.add(of + "whole_server_us_per_change", 1e6 * f.whole.server / f.changes, "us");
    report.add(of + "client_us_per_change", 1e6 * f.points.client / f.changes, "us");
    report.add(of + "made_us_per_change", 1e6 * f.points.made / f.changes, "us");
    report.add(of + "whole_client_us_per_change", 1e6 * f.whole.client / f.changes, "us");
    report.add(of + "decode_ms_p50", 1e3 * percentile(f.decode, 0.5), "ms");
    report.add(of + "decode_ms_p99", 1e3 * percentile(f.decode, 0.99), "ms");
    report.add(of + "made_ms_p50", 1e3 * percentile(f.made, 0.5), "ms");
    report.add(of + "made_ms_p99", 1e3 * percentile(f.made, 0.99), "ms");
    report.note(name + ": " + std::to_string(static_cast<int>(f.changes / (10 * f.seconds))) + " vertices come or go in an iteration");
  }
  report.note(
      "default settings, ten iterations a second, from the settled first picture on; processor time of one thread; bytes of whole "
      "messages; made: decoded, and all leaves made that changed");
  return report;
}

}  // namespace ridgecast::bench
