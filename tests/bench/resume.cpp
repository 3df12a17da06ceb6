// What a client that comes back costs, along the flights of the evaluation: a start from nothing, a resume at a server that knows nothing
// of the camera, and one that has its checkpoint. Every mesh is compared by its hash.
#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>

#include "client/core/mesh/follower.h"
#include "common/camera/path.h"
#include "common/terrain/terrain.h"
#include "common/wire/wire.h"
#include "server/conversation/conversation.h"
#include "server/encoding/encoder.h"
#include "server/handover/checkpoint.h"
#include "server/pipeline/pipeline.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"
#include "tests/bench/bench.h"

namespace ridgecast::bench {
namespace {

std::uint64_t hashOf(std::span<const mesh::LeafState> leaves) {
  std::uint64_t hash = 0;
  for (const mesh::LeafState& leaf : leaves) hash += mesh::hashTerm(leaf.address, leaf.hash);
  return hash;
}

// A server's camera, and what it sends.
struct Camera {
  explicit Camera(std::shared_ptr<const terrain::Terrain> ground)
      : terrain(std::move(ground)),
        executor(2),
        pool(executor.makePool(2)),
        pipeline(terrain, pipeline::grant({}, {}), pool),
        encoder(terrain, pool, {true, false, false}) {}
  double send(core::Follower& client) {
    wire::Iteration iteration;
    encoder.encode(replica.send(pipeline.leaves()), pipeline, iteration);
    const auto answer = client.apply(iteration);
    if (answer.wrong) throw std::runtime_error(answer.wrong->message);
    replica.acknowledge(iteration.number, answer.acknowledge.meshHash);
    return static_cast<double>(wire::encode(wire::ServerMessage(iteration)).size());
  }
  // Bytes until it rests.
  double settle(const camera::Camera& camera, core::Follower& client) {
    double bytes = 0;
    for (int k = 0; k < 300 && !pipeline.settled(); ++k) {
      pipeline.iterate(camera);
      bytes += send(client);
    }
    return bytes;
  }
  // As server/conversation does for a client that resumes.
  void catchUp(const camera::Camera& camera) {
    for (int k = 0; k <= conversation::kMaxUnsent && !pipeline.settled(); ++k) pipeline.iterate(camera);
  }

  std::shared_ptr<const terrain::Terrain> terrain;
  scheduling::Executor executor;
  std::shared_ptr<scheduling::Pool> pool;
  pipeline::Pipeline pipeline;
  replica::Replica replica{1, true};
  encoding::Encoder encoder;
};

core::Follower follower() {
  core::Follower client;
  client.follow({true, false, settings::kDefaultBudget});
  client.enter({});
  return client;
}

}  // namespace

Report resume(const Options& options) {
  Report report;
  for (const std::string name : {"alpine", "canyon", "archipelago"}) {
    progress(name);
    const auto path = camera::readPath(RIDGECAST_PATHS "/" + name + ".json");
    if (!path) throw std::runtime_error(path.error().message);
    const std::shared_ptr<const terrain::Terrain> terrain = terrain::create(name, path->seed).value();
    const auto at = [&](double t) {
      camera::Camera camera;
      camera.pose = camera::poseAt(*path, t, [&](lattice::Point p) { return terrain->height(p); });
      camera.projection.verticalFov = path->verticalFov;
      return camera;
    };
    Camera before(terrain);
    core::Follower client = follower();
    before.settle(at(0), client);
    const int frames = options.quick ? 10 : 100;
    for (int n = 1; n <= frames; ++n) {
      before.pipeline.iterate(at(n * 0.1));
      before.send(client);
    }
    const auto then = [&](int n) { return at((frames + n) * 0.1); };
    const auto add = [&](const char* figure, double value, const char* unit = "B") { report.add(name + "_" + figure, value, unit); };

    Camera fresh(terrain);
    core::Follower starts = follower();
    const double start = fresh.settle(then(0), starts);
    add("start_bytes", start);
    add("triangles", static_cast<double>(starts.scene().triangles()), "");

    Camera other(terrain);
    other.catchUp(then(0));
    // As before points were sent to a client that resumes: leaves that differ, whole.
    replica::Replica named(1, false);
    named.resume(client.scene().held());
    wire::Iteration whole;
    encoding::Encoder(terrain, other.pool, {false, false, false}).encode(named.send(other.pipeline.leaves()), other.pipeline, whole);
    add("whole_leaves", static_cast<double>(whole.whole.size()), "");
    add("whole_bytes", static_cast<double>(wire::encode(wire::ServerMessage(whole)).size()));
    // A client that names its leaves, and one that does not.
    for (const bool isNamed : {true, false}) {
      Camera anew(terrain);
      core::Follower resumes = follower();
      Camera again(terrain);  // the client's mesh is a copy of the mesh held
      if (!again.pipeline.restore(*before.pipeline.state(), then(0))) throw std::runtime_error("no mesh is restored");
      again.send(resumes);
      wire::World world;
      if (isNamed) world.revision = 6;
      double said = 0;
      for (const wire::Resume& part : resumes.enter(world)) {
        said += static_cast<double>(wire::encode(wire::ClientMessage(part)).size());
        if (!(isNamed ? anew.replica.resume(part.leaves) : anew.replica.resume(part.meshHash))) throw std::runtime_error("no resume");
      }
      anew.catchUp(then(0));
      double bytes = anew.send(resumes);
      add(isNamed ? "named_first_bytes" : "anew_first_bytes", bytes);
      bytes += anew.settle(then(0), resumes);
      add(isNamed ? "named_bytes" : "anew_bytes", bytes);
      add(isNamed ? "named_said_bytes" : "anew_said_bytes", said);
    }

    Clock clock;
    const auto record = handover::encode({1, 0, hashOf(before.pipeline.leaves()), *before.pipeline.state()}, *terrain);
    add("checkpoint_encode_ms", 1e3 * clock.seconds(), "ms");
    if (!record) throw std::runtime_error("a checkpoint is too large");
    add("checkpoint_bytes", static_cast<double>(record->size()));
    add("checkpoint_bytes_per_vertex", static_cast<double>(record->size()) / static_cast<double>(before.pipeline.state()->vertices.size()));
    Camera after(terrain);
    core::Follower moved = follower();
    Camera again(terrain);
    again.pipeline.restore(*before.pipeline.state(), then(0));
    again.send(moved);
    for (const wire::Resume& part : moved.enter({})) after.replica.resume(part.meshHash);
    clock = {};
    const auto checkpoint = handover::decode(*record, 1, *terrain, 2'000'000);
    add("checkpoint_decode_ms", 1e3 * clock.seconds(), "ms");
    clock = {};
    if (!checkpoint || !after.pipeline.restore(checkpoint->mesh, then(1))) throw std::runtime_error("no mesh is restored");
    if (hashOf(after.pipeline.leaves()) != checkpoint->meshHash) throw std::runtime_error("another mesh is restored");
    add("restore_ms", 1e3 * clock.seconds(), "ms");
    after.replica.restore(after.pipeline.leaves());
    const double first = after.send(moved);
    add("handover_first_bytes", first);
    // The flight goes on, with and without.
    double bytes = first, undisturbed = 0, slowest = 0;
    for (int n = 1; n <= 20; ++n) {
      before.pipeline.iterate(then(n));
      undisturbed += before.send(client);
      clock = {};
      after.pipeline.iterate(then(n));
      if (n == 1) slowest = 1e3 * clock.seconds();
      bytes += after.send(moved);
    }
    add("next_iteration_ms", slowest, "ms");
    add("undisturbed_bytes", undisturbed);
    add("handover_bytes", bytes - undisturbed);
    add("handover_share_of_start", (bytes - undisturbed) / start, "");
  }
  report.note(
      "default settings; a flight of 10 s, then: start and anew to rest at its last pose, the handover against the same flight without "
      "one");
  return report;
}

}  // namespace ridgecast::bench
