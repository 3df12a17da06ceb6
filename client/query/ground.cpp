#include "client/query/ground.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <deque>
#include <iterator>
#include <limits>
#include <mutex>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/edits/json.h"
#include "common/glsl/declaration.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"
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
    const auto declared = glsl::readDeclaration(world.terrainName, world.terrainSource);
    if (!declared || declared->parameters.size() != here->parameters) return nullptr;
    parameters = {glsl::valuesOf(world.terrainSource, *declared), world.terrainSource};
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

constexpr std::uint64_t kMaxFollowed = 20'000;  // edits of a session that are applied here; more take too long
constexpr std::size_t kRecent = 4096;           // edits whose areas are remembered
constexpr lattice::Area kEverywhere{-2 * lattice::kMaxPosition, -2 * lattice::kMaxPosition, 2 * lattice::kMaxPosition,
                                    2 * lattice::kMaxPosition};
constexpr std::size_t kBatch = 4000;   // places a query
constexpr std::size_t kInFlight = 16;  // queries

}  // namespace

// What has come of a session's edits. Its lock is held for moments.
struct Ground::Heard {
  Heard(const wire::World& world, bool keeps) : keepsOperations(keeps), session(world.session), contentHash(world.contentHash) {
    begin(world.compacted);
  }
  void begin(std::uint64_t after) {
    last = after;
    hash = contentHash;
    if (last > 0) add(session + " " + std::to_string(last));  // these edits are not told
    recent.clear();
    edits.clear();
  }
  void listen(link::Connection& to) {
    const std::lock_guard lock(mutex);
    core::EditsMade come = to.takeEdits();
    if (come.after < last) {
      begin(come.after);
      awaited = come.there;
      isAnew = true;
    }
    for (wire::MadeEdit& made : come.made) {
      last = made.number;
      recent.push_back({last, made.ground});
      if (recent.size() > kRecent) recent.pop_front();
      add(made.operation);
      if (keepsOperations) edits.push_back(std::move(made));
    }
  }
  std::uint64_t missing(link::Connection& from) {  // one to wait for; 0: none
    listen(from);
    const std::lock_guard lock(mutex);
    return last < awaited ? awaited : 0;
  }
  void add(std::string_view text) {
    for (std::size_t at = 0; at < text.size(); at += sizeof(std::uint64_t)) {
      std::uint64_t word = 0;
      std::memcpy(&word, text.data() + at, std::min(sizeof word, text.size() - at));
      hash = lattice::mix(hash ^ word);
    }
    hash = lattice::mix(hash + text.size());
  }

  std::mutex mutex;
  const bool keepsOperations;
  const std::string session;
  const std::uint64_t contentHash;
  std::uint64_t last = 0, awaited = 0;
  std::deque<Change> recent;
  std::uint64_t hash = 0;             // of the world and all operations
  std::vector<wire::MadeEdit> edits;  // not applied yet, if they are applied here
  bool isAnew = false;                // they are to be applied to the world's own ground
};

// What they have made of the terrain held here. Its lock is held while edits are applied.
struct Ground::Edited {
  explicit Edited(std::shared_ptr<const terrain::Terrain> terrain) : history(terrain), now(std::move(terrain)) {}
  Outcome<void> apply(Heard& heard) {
    std::vector<wire::MadeEdit> come;
    {
      const std::lock_guard lock(heard.mutex);
      come = std::exchange(heard.edits, {});
      if (std::exchange(heard.isAnew, false)) {
        now = history.terrain();
        history = edits::History(now);
        failed.reset();
      }
    }
    for (const wire::MadeEdit& made : come) {
      if (failed) break;
      auto operation = edits::fromJson(made.operation);
      if (operation && made.number != history.last() + 1) operation = Error{"one before it is missing"};
      const auto added = operation ? history.add(std::move(*operation)) : operation.error();
      if (!added) failed = Error{"the server's edit " + std::to_string(made.number) + " cannot be applied: " + added.error().message};
    }
    if (failed) return *failed;
    if (!come.empty()) now = std::make_shared<edits::EditedTerrain>(history.terrain(), history.layer());
    return {};
  }
  std::mutex mutex;
  edits::History history;
  std::shared_ptr<const terrain::Terrain> now;
  std::optional<Error> failed;  // from then on the ground here is not the session's
};

void Ground::know(std::uint64_t edit) {
  if (!heard_) return;
  const std::lock_guard lock(heard_->mutex);
  heard_->awaited = std::max(heard_->awaited, edit);
}

News Ground::since(std::uint64_t edit) const {
  if (!heard_) return {};
  heard_->listen(*connection_);
  const std::lock_guard lock(heard_->mutex);
  const auto& recent = heard_->recent;
  News news{heard_->last, heard_->awaited, {}};
  if (edit < heard_->last && (recent.empty() || edit + 1 < recent.front().edit))
    news.changes = {{heard_->last, kEverywhere}};
  else
    std::ranges::copy_if(recent, std::back_inserter(news.changes), [&](const Change& change) { return change.edit > edit; });
  return news;
}

Ground::Ground(link::Connection& connection, std::chrono::milliseconds timeout, std::shared_ptr<const terrain::Terrain> here)
    : connection_(&connection), timeout_(timeout), contentHash_(connection.world().contentHash) {
  const wire::World& world = connection.world();
  expects(!here || terrain::contentHash(*here) == contentHash_, "a terrain that is given is the world's");
  const bool followsEdits = connection.followsEdits();
  if (followsEdits && world.edit <= kMaxFollowed && world.compacted == 0) local_ = here ? std::move(here) : builtInOf(world);
  if (local_) edited_ = std::make_shared<Edited>(local_);
  if (followsEdits) heard_ = std::make_shared<Heard>(world, local_ != nullptr);
  know(world.edit);
}

Outcome<void> Ground::hear(std::chrono::milliseconds timeout) const {
  if (!heard_) return {};
  const std::uint64_t edit = heard_->missing(*connection_);
  if (edit == 0) return {};
  connection_->wait(timeout, [edit](const core::Reconnector& r) { return r.conversation().told() >= edit; });
  if (heard_->missing(*connection_) == 0) return {};
  return Error{"the session's " + std::to_string(edit) + " edits did not come within " + std::to_string(timeout.count()) + " ms"};
}

Outcome<Ground::Known> Ground::local() const {
  expects(local_ != nullptr, "a ground that the server answers for is not asked here");
  if (!edited_) return Known{local_};
  const std::lock_guard lock(edited_->mutex);
  if (auto come = hear(); !come) return come.error();
  if (auto applied = edited_->apply(*heard_); !applied) return applied.error();
  return Known{edited_->now, edited_->history.last()};
}

std::uint64_t Ground::hash() const {
  if (!heard_) return contentHash_;
  heard_->listen(*connection_);
  const std::lock_guard lock(heard_->mutex);
  return heard_->hash;
}

// `count` items in batches of `each`; each item's answer has `numbers` numbers.
template <class Number, class Make, class Take>
Outcome<void> Ground::ask(std::size_t count, std::size_t each, std::span<Number> out, std::size_t numbers, const Make& make,
                          const Take& take) const {
  expects(out.size() == count * numbers, "there is room for each answer");
  if (heard_) heard_->listen(*connection_);
  const auto until = std::chrono::steady_clock::now() + timeout_;
  std::deque<std::future<Outcome<wire::Answer>>> open;
  std::size_t requested = 0, taken = 0;
  while (taken < count) {
    while (requested < count && open.size() < kInFlight) {
      const std::size_t n = std::min(each, count - requested);
      open.push_back(connection_->ask(make(requested, n)));
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

Outcome<void> Ground::heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out,
                              std::uint64_t* edit) const {
  if (auto fits = checkPlaces(x.size(), z.size(), 1, out.size()); !fits) return fits;
  if (!local_) {
    if (edit) *edit = std::numeric_limits<std::uint64_t>::max();
    return ask(out.size(), kBatch, out, 1, placesOf(wire::QueryKind::kHeights, x, z),
               [edit](const wire::Answer& a) -> const std::vector<float>& {
                 if (edit) *edit = std::min(*edit, a.edit);
                 return a.heights;
               });
  }
  const auto here = local();
  if (!here) return here.error();
  here->terrain->heights(x, z, out);
  if (edit) *edit = here->edit;
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
  terrain::normals(*here->terrain, x, z, spacing, out);
  return {};
}

Outcome<void> Ground::materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const {
  if (auto fits = checkPlaces(x.size(), z.size(), 1, out.size()); !fits) return fits;
  if (!local_)
    return ask(out.size(), kBatch, out, 1, placesOf(wire::QueryKind::kMaterials, x, z),
               [](const wire::Answer& a) -> const std::vector<std::uint8_t>& { return a.materials; });
  const auto here = local();
  if (!here) return here.error();
  here->terrain->materials(x, z, out);
  return {};
}

std::vector<std::string> Ground::ownMaterials() const {
  if (local_) return {local_->ownMaterials().begin(), local_->ownMaterials().end()};
  std::vector<std::string> out;
  for (std::string_view rest = connection_->world().materials; !rest.empty();) out.emplace_back(text::takePart(rest, ' '));
  return out;
}

Outcome<void> Ground::cast(std::span<const ground::Ray> rays, std::span<double> out) const {
  if (auto fits = checkRoom(rays.size(), "rays", 1, out.size()); !fits) return fits;
  if (local_) {
    for (const ground::Ray& ray : rays)
      if (auto refusal = wire::refusalOf(ray); !refusal.empty()) return Error{std::move(refusal)};
    const auto here = local();
    if (!here) return here.error();
    ground::cast(*here->terrain, rays, out);
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
