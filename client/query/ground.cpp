#include "client/query/ground.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <mutex>
#include <thread>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/edits/json.h"
#include "common/user_terrain/declaration.h"
#include "common/wire/wire.h"

namespace ridgecast::query {

Outcome<lattice::Step> toSteps(double metres) {
  const double steps = std::floor(metres * lattice::kStepsPerMetre + 0.5);
  if (!(std::abs(steps) <= static_cast<double>(lattice::kMaxPosition)))
    return Error{"a place is a number of metres within 4.398e12 of the origin"};
  return static_cast<lattice::Step>(steps);
}

namespace {

// Whether the answers to so many questions, `each` numbers a question, fit exactly.
Outcome<void> checkRoom(std::size_t questions, const char* name, std::size_t each, std::size_t room) {
  if (room == each * questions) return {};
  return Error{std::to_string(questions) + " " + name + " need room for " + std::to_string(each * questions) + " numbers, not for " +
               std::to_string(room)};
}
Outcome<void> checkPlaces(std::size_t x, std::size_t z, std::size_t each, std::size_t room) {
  if (x == z) return checkRoom(x, "places", each, room);
  return Error{"a place has one x and one z, but " + std::to_string(x) + " x and " + std::to_string(z) + " z were given"};
}

std::shared_ptr<const terrain::Terrain> builtInOf(const wire::World& world) {
  const auto all = terrain::builtIn();
  const auto here = std::ranges::find(all, world.terrainName, &terrain::Description::name);
  if (here == all.end()) return nullptr;
  terrain::Parameters parameters;
  if (world.terrainSource != here->source) {
    const auto declared = user_terrain::readDeclaration(world.terrainName, world.terrainSource);
    if (!declared || declared->parameters.size() != here->parameters) return nullptr;
    parameters = {user_terrain::valuesOf(world.terrainSource, *declared), world.terrainSource};
  }
  auto terrain = terrain::create(world.terrainName, world.seed, std::move(parameters));
  if (!terrain || terrain::contentHash(**terrain) != world.contentHash) return nullptr;
  return *terrain;
}

// Queries for a part of these places.
auto placesOf(wire::QueryKind kind, std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::uint32_t spacing = 0) {
  return [=](std::size_t at, std::size_t n) {
    wire::Query q;
    q.kind = kind;
    q.spacing = spacing;
    const auto allX = x.subspan(at, n), allZ = z.subspan(at, n);
    q.x.assign(allX.begin(), allX.end());
    q.z.assign(allZ.begin(), allZ.end());
    return q;
  };
}

constexpr std::uint64_t kMostFollowed = 20'000;  // edits of a session that are applied here; more take too long
constexpr std::size_t kBatch = 4000;             // places a query
constexpr std::size_t kInFlight = 16;            // queries

}  // namespace

struct Ground::Edited {
  explicit Edited(std::shared_ptr<const terrain::Terrain> terrain) : history(terrain), now(std::move(terrain)) {}
  std::mutex mutex;
  edits::History history;
  std::shared_ptr<const terrain::Terrain> now;
  std::uint64_t atLeast = 0;  // edits
};

void Ground::know(std::uint64_t edit) {
  if (!edited_) return;
  const std::lock_guard lock(edited_->mutex);
  edited_->atLeast = std::max(edited_->atLeast, edit);
}

Ground::Ground(const wire::World& world, bool followsEdits, Ask ask, TakeEdits takeEdits, std::chrono::milliseconds timeout)
    : ask_(std::move(ask)), timeout_(timeout), takeEdits_(std::move(takeEdits)) {
  if (followsEdits && world.edit <= kMostFollowed && world.compacted == 0) local_ = builtInOf(world);
  if (local_) edited_ = std::make_shared<Edited>(local_);
  know(world.edit);
}

Outcome<std::shared_ptr<const terrain::Terrain>> Ground::local() const {
  if (!edited_) return local_;
  const std::lock_guard lock(edited_->mutex);
  edits::History& history = edited_->history;
  for (const auto until = std::chrono::steady_clock::now() + timeout_;;) {
    const std::uint64_t before = history.last();
    for (const wire::MadeEdit& made : takeEdits_()) {
      if (made.number <= history.last()) continue;  // of an earlier connection
      auto operation = edits::fromJson(made.operation);
      if (!operation || made.number != history.last() + 1)
        return Error{"the server's edit " + std::to_string(made.number) +
                     " cannot be applied: " + (operation ? "one before it is missing" : operation.error().message)};
      if (const auto added = history.add(std::move(*operation)); !added) return added.error();
    }
    if (history.last() > before) edited_->now = std::make_shared<edits::EditedTerrain>(local_, history.layer());
    if (history.last() >= edited_->atLeast) return edited_->now;
    if (std::chrono::steady_clock::now() >= until)
      return Error{"the session's " + std::to_string(edited_->atLeast) + " edits did not come within " + std::to_string(timeout_.count()) +
                   " ms"};
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

// `count` items in batches of `each`; each item's answer has `numbers` numbers.
template <class Number, class Make, class Take>
Outcome<void> Ground::ask(std::size_t count, std::size_t each, std::span<Number> out, std::size_t numbers, const Make& make,
                          const Take& take) const {
  takeEdits_();  // the server knows them
  const auto until = std::chrono::steady_clock::now() + timeout_;
  std::deque<std::future<Outcome<wire::Answer>>> open;
  std::size_t requested = 0, taken = 0;
  while (taken < count) {
    while (requested < count && open.size() < kInFlight) {
      const std::size_t n = std::min(each, count - requested);
      open.push_back(ask_(make(requested, n)));
      requested += n;
    }
    if (open.front().wait_until(until) != std::future_status::ready)
      return Error{"the server did not answer a query within " + std::to_string(timeout_.count()) + " ms"};
    auto answer = open.front().get();
    open.pop_front();
    if (!answer) return answer.error();
    const auto& values = take(*answer);
    const std::size_t n = std::min(each, count - taken);
    if (values.size() != n * numbers) return Error{"the server answered a query with another number of values than was requested"};
    std::copy(values.begin(), values.end(), out.begin() + static_cast<std::ptrdiff_t>(taken * numbers));
    taken += n;
  }
  return {};
}

Outcome<void> Ground::heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const {
  if (auto fits = checkPlaces(x.size(), z.size(), 1, out.size()); !fits) return fits;
  if (!local_)
    return ask(out.size(), kBatch, out, 1, placesOf(wire::QueryKind::kHeights, x, z),
               [](const wire::Answer& a) -> const std::vector<float>& { return a.heights; });
  const auto here = local();
  if (!here) return here.error();
  (*here)->heights(x, z, out);
  return {};
}

Outcome<void> Ground::normals(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out,
                              std::uint32_t spacing) const {
  if (auto fits = checkPlaces(x.size(), z.size(), 3, out.size()); !fits) return fits;
  if (!local_)
    return ask(x.size(), kBatch, out, 3, placesOf(wire::QueryKind::kNormals, x, z, spacing),
               [](const wire::Answer& a) -> const std::vector<float>& { return a.normals; });
  const auto here = local();
  if (!here) return here.error();
  ground::normals(**here, x, z, spacing, out);
  return {};
}

Outcome<void> Ground::cast(std::span<const ground::Ray> rays, std::span<double> out) const {
  if (auto fits = checkRoom(rays.size(), "rays", 1, out.size()); !fits) return fits;
  if (local_) {
    for (const ground::Ray& ray : rays)
      if (auto refusal = wire::refusalOf(ray); !refusal.empty()) return Error{std::move(refusal)};
    const auto here = local();
    if (!here) return here.error();
    for (std::size_t k = 0; k < rays.size(); ++k) out[k] = ground::cast(**here, rays[k]);
    return {};
  }
  return ask(
      rays.size(), wire::kMaxRays, out, 1,
      [&](std::size_t at, std::size_t n) {
        wire::Query q;
        q.kind = wire::QueryKind::kRays;
        q.rays.assign(rays.begin() + static_cast<std::ptrdiff_t>(at), rays.begin() + static_cast<std::ptrdiff_t>(at + n));
        return q;
      },
      [](const wire::Answer& a) -> const std::vector<double>& { return a.distances; });
}

Outcome<void> Ground::hits(std::span<const ground::Ray> rays, std::span<Hit> out) const {
  if (auto fits = checkRoom(rays.size(), "rays", 1, out.size()); !fits) return fits;
  std::vector<double> distances(rays.size());
  if (auto known = cast(rays, distances); !known) return known;
  std::vector<std::size_t> met;
  std::vector<lattice::Step> x, z;
  for (std::size_t k = 0; k < rays.size(); ++k) {
    out[k] = {};
    if (distances[k] == ground::kNoHit) continue;
    const ground::Ray& ray = rays[k];
    const double share = distances[k] / std::hypot(ray.directionX, ray.directionY, ray.directionZ);
    const auto moved = [&](lattice::Step from, double direction) {
      return std::clamp(from + static_cast<lattice::Step>(std::floor(direction * share * lattice::kStepsPerMetre + 0.5)),
                        -lattice::kMaxPosition, lattice::kMaxPosition);
    };
    out[k] = {
        .distance = distances[k], .at = {moved(ray.x, ray.directionX), moved(ray.z, ray.directionZ)}, .y = ray.y + ray.directionY * share};
    met.push_back(k);
    x.push_back(out[k].at.x);
    z.push_back(out[k].at.z);
  }
  std::vector<float> found(3 * met.size());
  if (auto known = normals(x, z, found); !known) return known;
  for (std::size_t k = 0; k < met.size(); ++k) std::copy_n(&found[3 * k], 3, out[met[k]].normal.begin());
  return {};
}

Outcome<double> Ground::height(double x, double z) const {
  const auto atX = toSteps(x), atZ = toSteps(z);
  if (!atX || !atZ) return (atX ? atZ : atX).error();
  float out = 0;
  if (const auto known = heights({&*atX, 1}, {&*atZ, 1}, {&out, 1}); !known) return known.error();
  return static_cast<double>(out);
}

}  // namespace ridgecast::query
