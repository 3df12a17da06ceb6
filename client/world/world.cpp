#include "client/world/world.h"

#include <algorithm>
#include <utility>

#include "client/core/mesh/mesh_ground.h"
#include "client/query/patch.h"
#include "common/terrain/terrain.h"
#include "common/text/text.h"
#include "common/wire/wire.h"

namespace ridgecast::world {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

namespace {

constexpr std::uint32_t kNear = 24;  // members heard of often
constexpr auto kMoment = 5ms;

// Time does not go back within a session, and at another server of it by no more than a setting takes to get there.
bool isOther(const wire::Clock& known, const wire::Clock& said) {
  constexpr std::uint64_t kOnItsWay = 1'000'000;
  const std::uint64_t late = known.mode == wire::ClockMode::kStepped ? 0 : kOnItsWay;
  return said.end == 0 && (said.step < known.step || said.time + late < known.time);
}

std::string placeOf(const wire::Clock& clock) {
  std::string thousandths = std::to_string(clock.time / 1000 % 1000);
  thousandths.insert(0, 3 - thousandths.size(), '0');
  return "step " + std::to_string(clock.step) + ", " + std::to_string(clock.time / 1'000'000) + "." + thousandths + " s";
}

std::chrono::milliseconds left(Clock::time_point until) {
  return std::max(std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()), 0ms);
}

}  // namespace

World::World(std::unique_ptr<link::Client> client, const Options& options)
    : client_(std::move(client)),
      info_(client_->world()),
      timeout_(options.timeout),
      follows_(options.follows),
      ground_(client_->connection(), options.timeout, options.terrain) {
  client_->connection().skipSteps(!follows_);
}

Result<std::unique_ptr<World>> World::join(std::string_view url, const Options& options) {
  auto parsed = core::parseUrl(url);
  if (!parsed) return Failure{Fault::kInvalid, parsed.error().message};
  parsed->ca = options.ca;
  parsed->token = options.token;
  const wire::Hello hello{.clientName = options.name,
                          .settings = options.settings,
                          .pacing = options.pacing,
                          .role = options.camera ? wire::Role::kViewer : wire::Role::kSensor,
                          .members = true,
                          .clock = true,
                          .errors = options.errors,
                          .edits = true,
                          .near = options.everybody ? 0u : kNear,
                          .states = true,
                          .placesOnly = options.placesOnly || !options.camera};
  const auto until = Clock::now() + options.timeout;
  auto client = link::Client::open(*parsed, hello, {.reconnects = options.reconnects, .timeout = options.timeout});
  if (!client) return Failure{Fault::kRefused, client.error().message};
  if (const std::uint64_t theirs = (*client)->world().contentHash; options.terrain && terrain::contentHash(*options.terrain) != theirs)
    return Failure{Fault::kRefused, "the session's terrain has the hash " + text::hexadecimal(theirs) + ", and the one given " +
                                        text::hexadecimal(terrain::contentHash(*options.terrain)) +
                                        ": open the same file, with the same seed, parameters and options"};
  std::unique_ptr<World> world(new World(std::move(*client), options));
  if (world->info_.revision >= 1)
    if (const auto heard = world->clockHeard(until); !heard) return heard.error();
  world->clock();
  return world;
}

// Why a call failed that had until then.
Failure World::failure(const Error& error, Instant until) const {
  const bool lost = client_->connection().error().has_value();
  return {lost ? Fault::kLost : Clock::now() >= until ? Fault::kTimeout : Fault::kRefused, error.message};
}

Result<void> World::connected(Instant until) {
  const link::Connection& connection = client_->connection();
  while (const auto why = connection.error()) {
    client_->receive(0ms);  // takes what came before, or goes on with another conversation
    if (!connection.error()) break;
    if (connection.otherWorld()) return Failure{Fault::kLost, "the server came back with another world: join again"};
    if (Clock::now() >= until || !connection.comesBack())
      return Failure{Fault::kLost, "the connection is lost: " + connection.error().value_or(*why).message};
    connection.wait(left(until),
                    [](const core::Reconnector& r) { return r.conversation().hasIterations() || r.hasReturned() || !r.comesBack(); });
  }
  return {};
}

template <class Ask>
Result<void> World::query(const Ask& ask) {
  const auto until = Clock::now() + timeout_;
  for (;;) {
    if (!isLocal())
      if (auto there = connected(until); !there) return there;
    const auto answered = ask();
    if (answered) return {};
    if (isLocal()) return Failure{Fault::kInvalid, answered.error().message};
    const Failure why = failure(answered.error(), until);
    if (why.fault != Fault::kLost || Clock::now() >= until) return why;
  }
}

Result<void> World::heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) {
  return query([&] { return ground_.heights(x, z, out); });
}

Result<void> World::materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) {
  return query([&] { return ground_.materials(x, z, out); });
}

Result<void> World::normals(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out,
                            std::uint32_t spacing) {
  return query([&] { return ground_.normals(x, z, out, spacing); });
}

Result<void> World::hits(std::span<const ground::Ray> rays, std::span<query::Hit> out) {
  for (const ground::Ray& ray : rays)
    if (auto refusal = wire::refusalOf(ray); !refusal.empty()) return Failure{Fault::kInvalid, std::move(refusal)};
  return query([&] { return ground_.hits(rays, out); });
}

Result<Mesh> World::ground(lattice::Point at, double radius, double error, Milliseconds timeout) {
  if (std::string refusal = wire::refusalOf(wire::AskGround{0, at, radius, error}); !refusal.empty())
    return Failure{Fault::kInvalid, std::move(refusal)};
  for (const auto until = Clock::now() + timeout;;) {
    if (auto there = connected(until); !there) return there.error();
    const auto patch = query::groundAround(client_->connection(), at, radius, error, left(until));
    if (patch) {
      Mesh mesh = meshOf(patch->scene.leaves(), at);
      mesh.error = patch->error;
      return mesh;
    }
    Failure why = failure(patch.error(), until);
    if (why.fault != Fault::kLost || Clock::now() >= until) return why;
  }
}

core::SessionClock World::clock() {
  client_->receive(0ms);
  auto clock = client_->connection().clock();
  if (clock.version() == 0) return clock_;  // back, and not told yet
  if (lost_ || !isOther(known_, clock.said())) known_ = clock.said();
  return clock_ = clock;
}

// Waits until the clock heard satisfies `done`.
template <class Done>
Result<void> World::clockUntil(Instant until, const Done& done) {
  for (;;) {
    const auto& connection = client_->connection();
    const auto clock = connection.clock();
    if (done(clock)) return {};
    if (const auto why = connection.error()) return Failure{Fault::kLost, why->message};
    if (Clock::now() >= until) return Failure{Fault::kTimeout, "the server did not answer in time"};
    connection.waitForClock(clock.version(), left(until));
  }
}

Result<void> World::clockHeard(Instant until) {
  const bool waits = client_->connection().error().has_value();
  if (auto there = connected(until); !there) return there;
  if (auto heard = clockUntil(until, [](const core::SessionClock& clock) { return clock.version() > 0; }); !heard) return heard;
  // Who waits in slices takes a loss at a slice's end for a connection that is not there yet, and calls again: then it is told the rest.
  if (waits && left(until) < kMoment) return Failure{Fault::kLost, "the connection has only just come back"};
  return {};
}

// Why a call has no effect, once.
std::optional<Failure> World::begunAnew() {
  const wire::Clock said = client_->connection().clock().said(), known = std::exchange(known_, said);
  if (!isOther(known, said)) return std::nullopt;
  return Failure{Fault::kLost, "the server is back without the session's clock, which has begun anew: it was at " + placeOf(known) +
                                   " and is at " + placeOf(said)};
}

// Waits until the clock is this member's and satisfies `done`.
template <class Done>
Result<void> World::takeClock(const wire::SetClock& set, Instant until, const Done& done) {
  const std::uint64_t before = client_->connection().clock().version();
  client_->connection().setClock(set);
  std::string refused;
  auto taken = clockUntil(until, [&](const core::SessionClock& clock) {
    const wire::Clock& said = clock.said();
    if (clock.version() > before && said.owner != 0 && said.owner != camera())
      refused = "member " + std::to_string(said.owner) + " owns the clock";
    else if (clock.refused() > before)
      refused = clock.notice();
    return !refused.empty() || (said.owner == camera() && done(said, clock.version() > before));
  });
  if (taken && !refused.empty()) return Failure{Fault::kRefused, refused};
  if (taken) known_ = client_->connection().clock().said();
  return taken;
}

Result<void> World::setClock(wire::ClockMode mode, double rate, Milliseconds timeout) {
  const auto until = Clock::now() + timeout;
  if (auto heard = clockHeard(until); !heard) return heard;
  if (const auto lost = begunAnew()) return *lost;
  return takeClock({.own = true, .mode = mode, .rate = rate}, until, [&](const wire::Clock& said, bool) {
    return said.mode == mode && (mode != wire::ClockMode::kScaled || said.rate == rate);
  });
}

Result<void> World::jump(Microseconds time, Milliseconds timeout) {
  if (time < 0us || time.count() > static_cast<std::int64_t>(wire::kMaxTime))
    return Failure{Fault::kInvalid, "a clock's time is 0 to 2^53 microseconds"};
  const auto to = std::max<std::uint64_t>(static_cast<std::uint64_t>(time.count()), 1);  // 0 says that it does not jump
  std::optional<Instant> sent;
  for (const auto until = Clock::now() + timeout;;) {
    if (auto heard = clockHeard(until); !heard) return heard;
    if (const auto lost = begunAnew()) return *lost;
    const auto clock = client_->connection().clock();
    const auto now = Clock::now();
    const wire::Clock& said = clock.said();
    const std::uint64_t is = clock.time(now), end = said.end == 0 ? to : std::min(to, said.end);
    if (sent) {  // the connection was lost since then
      const double passed = std::chrono::duration<double, std::micro>(now - *sent).count() * said.rate;
      if (is >= end && static_cast<double>(is - end) <= passed + static_cast<double>(clock.uncertainty(now).count())) return {};
    }
    const bool isBack = is > to;
    if (isBack && said.end == 0) return Failure{Fault::kRefused, "time goes back only in recordings"};
    if (said.end == 0 && to > is + wire::kMaxStepTime) return Failure{Fault::kRefused, "a jump takes the clock at most an hour ahead"};
    sent = now;
    bool stands = false;
    auto set = takeClock({true, said.mode, said.rate, to}, until, [&](const wire::Clock& heard, bool isNew) {
      stands = isNew && !heard.waitsFor.empty();
      return !isBack && (stands || heard.time >= end);
    });
    if (set && stands) return Failure{Fault::kRefused, "the clock does not jump while a step is under way"};
    if (set || set.error().fault != Fault::kLost) return set;
  }
}

Result<void> World::step(Microseconds time, Milliseconds timeout) {
  if (time < 0us || time > 1h) return Failure{Fault::kInvalid, "a step is 1 microsecond to 1 hour"};
  if (time > 0us) {
    unsent_ = time;
    lost_.reset();
  }
  const auto until = Clock::now() + timeout;
  const Failure unknown{Fault::kLost, "the connection was lost while a step was under way: read the clock before the next one"};
  if (awaited_ > 0 && awaitedOf_ != reconnections()) {
    awaited_ = 0;
    if (unsent_ == 0us) lost_ = unknown;
  }
  if (lost_) return *lost_;
  if (unsent_ > 0us) {
    if (auto heard = clockHeard(until); !heard) return heard;
    lost_ = begunAnew();
    if (lost_) {
      unsent_ = 0us;
      return *lost_;
    }
    const wire::Clock said = client_->connection().clock().said();
    if (said.owner != camera() || said.mode != wire::ClockMode::kStepped)
      if (auto mine = setClock(wire::ClockMode::kStepped, 0, left(until)); !mine) {
        if (mine.error().fault == Fault::kRefused) unsent_ = 0us;
        return mine;
      }
    awaited_ = std::max(awaited_, client_->connection().clock().said().step) + 1;
    awaitedOf_ = reconnections();
    awaitedSince_ = client_->connection().clock().version();
    client_->connection().step({static_cast<std::uint64_t>(std::exchange(unsent_, 0us).count()), true});
  }
  std::string refused;
  auto stepped = clockUntil(until, [&](const core::SessionClock& clock) {
    if (clock.refused() > awaitedSince_ && clock.said().step < awaited_) refused = clock.notice();
    return !refused.empty() || clock.said().step > awaited_ || (clock.said().step == awaited_ && clock.said().waitsFor.empty());
  });
  if (stepped || stepped.error().fault == Fault::kLost) awaited_ = 0;
  if (!refused.empty()) return Failure{Fault::kRefused, refused};
  if (stepped) {
    known_ = client_->connection().clock().said();
    return {};
  }
  if (stepped.error().fault != Fault::kLost) return waitedFor();
  lost_ = unknown;
  return unknown;
}

Result<std::uint64_t> World::edit(const std::string& operation, std::string key, Milliseconds timeout) {
  const auto until = Clock::now() + timeout;
  if (key.empty()) {
    std::random_device random;
    for (int k = 0; k < 4; ++k) key += std::to_string(random());
  }
  for (;;) {
    if (auto there = connected(until); !there) return there.error();
    if (!edit_.answer.valid() || edit_.key != key || edit_.operation != operation || edit_.connection != reconnections())
      edit_ = {key, operation, reconnections(), client_->connection().edit({0, key, operation})};
    if (edit_.answer.wait_until(until) != std::future_status::ready)
      return Failure{Fault::kTimeout, "the server did not answer an edit within " + std::to_string(timeout.count()) + " ms"};
    const auto made = edit_.answer.get();
    if (made) {
      ground_.know(made->number);
      return made->number;
    }
    const Failure why = failure(made.error(), until);
    if (why.fault != Fault::kLost || Clock::now() >= until) return why;
  }
}

Failure World::waitedFor() const {
  const auto said = client_->connection().clock().said();
  const auto roster = client_->connection().others();
  std::string who;
  for (const std::uint64_t member : said.waitsFor) {
    who.append(who.empty() ? "" : ", ").append("member ").append(std::to_string(member));
    if (!roster) continue;
    if (const auto other = roster->others().find(member); other != roster->others().end() && !other->second.member.name.empty())
      who.append(" (").append(other->second.member.name).append(")");
  }
  if (who.empty()) return {Fault::kTimeout, "the server did not answer in time"};
  return {Fault::kTimeout, "step " + std::to_string(said.step) + " is not done by " + who};
}

Result<std::uint64_t> World::nextStep(Milliseconds timeout) {
  if (!follows_) return Failure{Fault::kInvalid, "this member does not follow the clock: join so that it does"};
  for (const auto until = Clock::now() + timeout;;) {
    if (auto heard = clockHeard(until); !heard) return heard.error();
    if (auto lost = begunAnew()) return *lost;
    const auto clock = client_->connection().clock();
    if (stepOf_ != reconnections()) {
      stepOf_ = reconnections();
      step_ = clock.said().step - (clock.waitsFor(camera()) ? 1 : 0);
    } else if (clock.waitsFor(camera()) && clock.said().step == step_) {
      client_->connection().stepDone({step_});
    }
    auto next = clockUntil(until, [&](const core::SessionClock& c) { return c.said().step > step_; });
    if (!next && next.error().fault == Fault::kLost && Clock::now() < until) continue;  // the next step of a server that is back
    if (!next && next.error().fault == Fault::kTimeout) return Failure{Fault::kTimeout, "no step began in time"};
    if (!next) return next.error();
    known_ = client_->connection().clock().said();
    step_ = known_.step;
    return known_.time;
  }
}

std::vector<core::Other> World::others() {
  std::vector<core::Other> all;
  const core::Roster now = roster();
  for (const auto& [camera, other] : now.others()) all.push_back(other);
  return all;
}

core::Roster World::roster() {
  client_->receive(0ms);
  auto roster = client_->connection().others();
  return roster ? std::move(*roster) : core::Roster();
}

Result<std::uint64_t> World::send(const camera::Camera& camera, std::span<const std::uint8_t> state) {
  if (!camera::isValid(camera))
    return Failure{Fault::kInvalid,
                   "a pose has finite numbers, a pitch within a quarter turn, and a field of view between 0 and half a turn"};
  if (state.size() > wire::kMaxStateBytes)
    return Failure{Fault::kInvalid, "a member's state has at most " + std::to_string(wire::kMaxStateBytes) + " bytes"};
  return client_->send(camera, {state.begin(), state.end()});
}

Result<link::Update> World::receive(Milliseconds timeout) {
  const auto until = Clock::now() + timeout;
  if (auto update = client_->receive(timeout)) return std::move(*update);
  if (auto there = connected(until); !there) return there.error();
  return Failure{Fault::kTimeout, "no iteration came in time: the server is busy, or nothing changed"};
}

Result<link::Update> World::fly(const camera::Camera& camera, Milliseconds timeout, std::span<const std::uint8_t> state) {
  const auto sent = send(camera, state);
  if (!sent) return sent.error();
  for (const auto until = Clock::now() + timeout;;) {
    auto update = receive(left(until));
    if (!update || update->iteration.poseSequence >= *sent) return update;
  }
}

}  // namespace ridgecast::world
