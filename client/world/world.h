#pragma once
// A session's world, as seen by a member: the true terrain, the ground as triangles, the clock, the other members, and the mesh that a
// camera sees, over a connection that reconnects by itself.
//
//     const auto rover = world::World::join("ws://127.0.0.1:7070?session=race&terrain=canyon", {.name = "rover"}).value();
//     rover->heights(x, z, out).value();
//     rover->step(20ms, 10s).value();  // all who follow the clock have done it, or the error names who has not
//
// | functions                      | thread                    | wait                                                                    |
// |--------------------------------|---------------------------|-------------------------------------------------------------------------|
// | heights, normals, hits         | any, if isLocal()         | for the server, if not isLocal()                                        |
// | terrain, info, isLocal         | any                       | terrain().heights() and the like for the server, if not isLocal()       |
// | all others                     | one at a time (the owner) | those with a `timeout`: at most that                                    |
//
// While the connection is lost, a call waits for it within its timeout and then continues.

#include <chrono>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <boost/system/result.hpp>
#include <stdexcept>

#include "client/core/conversation/roster.h"
#include "client/core/conversation/session_clock.h"
#include "client/link/client.h"
#include "client/query/ground.h"
#include "client/world/mesh.h"
#include "common/camera/camera.h"
#include "common/ground/ground.h"
#include "common/settings/settings.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::world {

// Why a call failed, for programs; `message` says it for people.
enum class Fault {
  kInvalid,  // the call itself: out of range, sizes that do not match
  kRefused,  // the server says no
  kLost,     // there is no connection, or the server came back with another world
  kTimeout,  // the server or a member did not answer in time
};
struct Failure {
  Fault fault = Fault::kInvalid;
  std::string message;
};
[[noreturn]] inline void throw_exception_from_error(const Failure& f, const boost::source_location&) {
  throw std::runtime_error(f.message);
}
template <class T>
using Result = boost::system::result<T, Failure>;

struct Options {
  std::string name = {};                      // shown to the others
  bool camera = true;                         // false: a sensor, whose only mesh is what it requests with ground(); placesOnly
  settings::Settings settings = {};           // of the mesh
  bool follows = false;                       // the clock: each step waits until this member has done it (nextStep)
  wire::Pacing pacing = wire::Pacing::kFree;  // of the mesh
  std::string ca = {}, token = {};            // core::Url
  std::chrono::milliseconds timeout{10'000};  // of join(), and of queries
  bool reconnects = true;
  bool everybody = false;                                // hears of each member, not only of those near it (Hello.near)
  std::shared_ptr<const terrain::Terrain> terrain = {};  // the session's, held here, so that the server need not be asked; null: any
  bool placesOnly = false;  // no mesh of what its camera sees: its poses only say where it is; fly() and receive() get no iterations
  bool errors = false;      // Mesh::error of the mesh held is known; takes the server several times what making the mesh takes
};

class World {
 public:
  using Milliseconds = std::chrono::milliseconds;
  using Microseconds = std::chrono::microseconds;

  // `url`: core::parseUrl. The session is made if there is none and the URL names a terrain.
  static Result<std::unique_ptr<World>> join(std::string_view url, const Options& options);

  const wire::World& info() const { return info_; }
  std::uint64_t camera() const { return client_->world().camera; }  // this member's number; another one after a reconnection
  bool isLocal() const { return ground_.source() == query::Ground::Source::kLocal; }

  // The true terrain: query/ground.h. (terrain() does not wait for a lost connection.)
  const query::Ground& terrain() const { return ground_; }
  Result<void> heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out);
  Result<void> materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out);
  Result<void> normals(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out, std::uint32_t spacing);
  Result<void> hits(std::span<const ground::Ray> rays, std::span<query::Hit> out);

  // All triangles over the circle, in metres from `at`, at most `error` metres off.
  Result<Mesh> ground(lattice::Point at, double radius, double error, Milliseconds timeout);

  // The clock as last heard; exact while it is stepped. A server that failed may be back without it: it has then begun anew, and the next
  // of the calls below is kLost, has no effect, and says so.
  core::SessionClock clock();
  // Takes the clock, if no other member owns it, and sets it.
  Result<void> setClock(wire::ClockMode mode, double rate, Milliseconds timeout);
  // Takes the clock, if no other member owns it, and moves it to this time, but not while a step is pending: at most an hour ahead; in a
  // recording anywhere, and going back restarts it there, and the connection with it.
  Result<void> jump(Microseconds time, Milliseconds timeout);
  // Moves a stepped or unowned clock by `time`, and waits until every member that follows it has done the step. After kTimeout the step is
  // still pending: call with 0 to keep waiting for it. kRefused: there is no step. (Another time replaces one that was not sent, as after
  // kLost.)
  Result<void> step(Microseconds time, Milliseconds timeout);
  // For a member that follows: reports the last returned step as done, waits for the next one and returns the session's time.
  Result<std::uint64_t> nextStep(Milliseconds timeout);
  // For the owner: steps do not wait for this member until it has caught up.
  void passOver(std::uint64_t member) { client_->connection().passOver(member); }

  // Changes the ground for everybody: an operation as JSON (common/edits/json.h). Returns its number: it is then stored, and in all later
  // answers and meshes. `key`: an edit resent with it, by the same client under the same name, is made once; empty: a new one for each
  // call, so that a connection lost meanwhile makes no edit twice. After kTimeout, the same call with the same key keeps waiting.
  // kRefused: the server's sentence.
  Result<std::uint64_t> edit(const std::string& operation, std::string key, Milliseconds timeout);

  // Those near it, or everybody (Options), live.
  std::vector<core::Other> others();
  // Those and all the others, as counts.
  core::Roster roster();

  // Sends a pose and returns its iteration, or a later one: the mesh held is then the server's.
  Result<link::Update> fly(const camera::Camera& camera, Milliseconds timeout, std::span<const std::uint8_t> state = {});
  // The halves of fly(): send() never waits; receive() gives kTimeout if no iteration came. `state`: what the others hear of this member,
  // at most wire::kMaxStateBytes. Returns the pose's sequence.
  Result<std::uint64_t> send(const camera::Camera& camera, std::span<const std::uint8_t> state = {});
  Result<link::Update> receive(Milliseconds timeout);
  const core::Scene& scene() const { return client_->scene(); }
  std::uint64_t reconnections() const { return client_->connection().reconnections(); }

 private:
  using Instant = std::chrono::steady_clock::time_point;
  World(std::unique_ptr<link::Client> client, const Options& options);
  Result<void> connected(Instant until);
  Failure failure(const Error& error, Instant until) const;
  template <class Ask>
  Result<void> query(const Ask& ask);
  template <class Done>
  Result<void> clockUntil(Instant until, const Done& done);
  Result<void> clockHeard(Instant until);
  std::optional<Failure> begunAnew();
  template <class Done>
  Result<void> takeClock(const wire::SetClock& set, Instant until, const Done& done);
  Failure waitedFor() const;

  const std::unique_ptr<link::Client> client_;
  const wire::World info_;
  const Milliseconds timeout_;
  const bool follows_;
  query::Ground ground_;
  wire::Clock known_;                    // to who uses this
  core::SessionClock clock_;             // as clock() knew it last
  std::uint64_t step_ = 0;               // returned last by nextStep()
  std::optional<std::uint64_t> stepOf_;  // reconnections() then

  // For edit(): the last one sent.
  struct SentEdit {
    std::string key, operation;
    std::uint64_t connection = 0;  // reconnections() then
    std::future<Outcome<wire::EditAnswer>> answer;
  };
  SentEdit edit_;

  // For step(): first `unsent_` is to be sent, then the clock's step `awaited_` to be done.
  Microseconds unsent_{0};
  std::uint64_t awaited_ = 0, awaitedOf_ = 0, awaitedSince_ = 0;  // reconnections(), the clock's version() then
  std::optional<Failure> lost_;  // instead, until the next step: its outcome is unknown, or the clock has begun anew
};

}  // namespace ridgecast::world
