#include "server/directory/directory.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"

namespace ridgecast::directory {

Directory::Directory(std::shared_ptr<const session::Resources> resources, std::shared_ptr<const terrain::Terrain> defaultTerrain,
                     std::vector<std::pair<std::string, double>> defaultParameters)
    : resources_(std::move(resources)),
      quota_(std::make_shared<session::CameraQuota>(resources_->limits.maxCameras, resources_->limits.maxTotalTriangles)),
      reservations_(resources_->state, resources_->bus->server() != 0),
      default_{std::move(defaultTerrain), std::move(defaultParameters)},
      worlds_(std::make_shared<SharedWorlds>(resources_->bus, kGrace + resources_->limits.sessionIdle)) {
  expects(resources_->executor && default_.terrain, "a server has threads, and a terrain to begin with");
  const bool isElsewhere = reservations_.isElsewhere(std::string(kDefaultName));
  if (isShared() && isElsewhere)
    throw std::runtime_error("Another server uses the folder '" + resources_->state.string() +
                             "'; each server with --shared has a --state folder of its own.");
  if (auto added = addDefault(); !added && !isElsewhere) added.value();
}

Outcome<std::shared_ptr<session::Session>> Directory::addDefault() {
  return add(std::string(kDefaultName), default_.terrain, default_.parameters);
}

void Directory::awaitDefault() {
  if (find(kDefaultName)) return;
  if (!awaiting_) {
    awaiting_ = resources_->writer().makePool(1);
    if (reservations_.isElsewhere(std::string(kDefaultName)))
      logging::info({.session = std::string(kDefaultName)}, "another server has it; this one takes it when that one lets go of it");
  }
  constexpr std::chrono::milliseconds kPause{100};
  resources_->timer->at(resources_->timer->now() + kPause, [weak = weak_from_this()] {
    const auto self = weak.lock();
    if (!self) return;
    if (self->reservations_.isElsewhere(std::string(kDefaultName))) return self->awaitDefault();
    self->awaiting_->post([weak] {  // its edits may take seconds
      const auto directory = weak.lock();
      if (!directory) return;
      auto reservation = directory->reserve(std::string(kDefaultName));
      if (reservation && !*reservation) {  // here, or still closing its log
        if (!directory->find(kDefaultName)) directory->awaitDefault();
        return;
      }
      const auto added = reservation ? directory->add(std::move(*reservation), directory->default_.terrain, directory->default_.parameters)
                                     : reservation.error();
      if (added) return logging::info({.session = std::string(kDefaultName)}, "is this server's now");
      if (directory->reservations_.isElsewhere(std::string(kDefaultName))) return directory->awaitDefault();
      logging::error({.session = std::string(kDefaultName)}, "nobody can enter it: " + added.error().message);
    });
  });
}

std::shared_ptr<session::Session> Directory::find(std::string_view name) const {
  const std::lock_guard lock(mutex_);
  const auto it = sessions_.find(name);
  return it == sessions_.end() ? nullptr : it->second.session;
}

Outcome<std::unique_ptr<Reservation>> Directory::reserve(const std::string& name) const {
  auto reservation = reservations_.take(name);
  if (reservation && find(name)) reservation->reset();
  return reservation;
}

Outcome<std::shared_ptr<session::Session>> Directory::add(const std::string& name, std::shared_ptr<const terrain::Terrain> terrain,
                                                          std::vector<std::pair<std::string, double>> parameters, std::string maker,
                                                          wire::ClockMode clock) {
  if (!wire::sessionNameIsValid(name))
    return Error{"A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens."};
  auto reservation = reserve(name);
  if (!reservation) return reservation.error();
  if (!*reservation) return Error{"There is a session named '" + name + "' already; choose another name."};
  expects(!isShared() || name == kDefaultName, "a name that servers share is claimed before it is added");
  if (isShared()) (*reservation)->claim({defaultWorld(*terrain, parameters), 0}, true);
  return add(std::move(*reservation), std::move(terrain), std::move(parameters), std::move(maker), clock);
}

Outcome<std::shared_ptr<session::Session>> Directory::add(std::unique_ptr<Reservation> reservation,
                                                          std::shared_ptr<const terrain::Terrain> terrain,
                                                          std::vector<std::pair<std::string, double>> parameters, std::string maker,
                                                          wire::ClockMode clock) {
  const std::string& name = reservation->name();
  expects(terrain && (!isShared() || reservation->claimed()), "a session has a terrain, and its name on all servers");
  const auto claimed = reservation->claimed().value_or(SharedWorlds::Standing{});
  std::sort(parameters.begin(), parameters.end());
  session::WorldSpec spec{std::string(terrain->name()), terrain->seed(), std::move(parameters), clock};
  auto kept = reservation->keep({spec.terrain, spec.seed, spec.parameters, terrain::contentHash(*terrain)}, terrain);
  if (!kept) return kept.error();
  kept->left = [weak = weak_from_this(), name] {
    if (const auto self = weak.lock()) self->letGo(name);
  };
  auto session = std::make_shared<session::Session>(name, std::move(terrain), std::move(spec), resources_, quota_, std::move(*kept));
  const Kept added{session, std::move(maker), 0, {}, claimed.world, claimed.epoch};
  if (isShared()) session->claimBeforeEdits(claimOf(name, claimed.world));
  {
    const std::lock_guard lock(mutex_);
    if (!reservation->joins())
      if (auto full = fullFor(added.maker)) return Error{std::move(full->sentence)};
    expects(sessions_.emplace(name, added).second, "a name that is reserved is free");
    sweepSoon();
  }
  if (claimed.epoch > 0) renew(name, added);  // it was claimed for a moment
  return session;
}

bool Directory::replace(const std::shared_ptr<session::Session>& session, std::shared_ptr<const terrain::Terrain> terrain,
                        const std::function<void(const session::Session& successor)>& prepare) {
  expects(session && terrain, "a successor has a predecessor and a terrain");
  auto successor = std::make_shared<session::Session>(session->name(), std::move(terrain), session->spec(), resources_, quota_);
  if (prepare) prepare(*successor);
  const std::lock_guard lock(mutex_);
  const auto it = sessions_.find(session->name());
  if (it == sessions_.end() || it->second.session != session) return false;
  if (session->uses() > 0) successor->use();  // so that it waits for its members as long
  expects(!isShared(), "a world that servers share does not change");
  it->second = Kept{std::move(successor), std::move(it->second.maker), 0, {}};
  session->retire();
  return true;
}

std::shared_ptr<session::Session> Directory::take(Sessions::iterator it) {
  std::shared_ptr<session::Session> session = std::move(it->second.session);
  sessions_.erase(it);
  session->retire();
  return session;
}

std::shared_ptr<session::Session> Directory::remove(std::string_view name) {
  Kept kept;
  {
    const std::lock_guard lock(mutex_);
    const auto it = sessions_.find(name);
    if (it == sessions_.end() || name == kDefaultName) return nullptr;
    kept = it->second;
    kept.session->clock().end();
    take(it);
  }
  if (isShared()) worlds_->end(kept.session->name(), kept.world.id, kept.epoch);
  return kept.session;
}

void Directory::letGo(const std::string& name) {
  std::shared_ptr<session::Session> session;
  {
    const std::lock_guard lock(mutex_);
    const auto it = sessions_.find(name);
    if (it == sessions_.end() || !it->second.session->edits().isOver()) return;
    session = take(it);
  }
  for (const auto& camera : session->live().all()) camera->goAway();
  if (name == kDefaultName) awaitDefault();
}

std::vector<std::shared_ptr<session::Session>> Directory::all() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<session::Session>> out;
  for (const auto& [name, kept] : sessions_) out.push_back(kept.session);
  return out;
}

std::optional<Directory::Full> Directory::full(std::string_view maker) const {
  const std::lock_guard lock(mutex_);
  return fullFor(maker);
}

std::optional<Directory::Full> Directory::fullFor(std::string_view maker) const {
  const session::Limits& limits = resources_->limits;
  std::size_t all = sessions_.size(),
              made = std::ranges::count_if(sessions_, [&](const auto&entry) { return entry.second.maker == maker; });
  std::set<std::string_view> there;
  for (const ServerStatus& server : *others_)
    for (const auto& [name, its] : server.sessions)
      if (!sessions_.contains(name) && there.insert(name).second) made += its.world.maker == maker;
  all += there.size();
  if (!maker.empty() && limits.maxSessionsPerClient != 0 && made >= limits.maxSessionsPerClient)
    return Full{true, "The " + std::string(maker) + " has made " + std::to_string(made) +
                          " of the sessions that live here, the most one client may; leave one until it ends, or join one by its name."};
  if (all >= limits.maxSessions)
    return Full{false, (isShared() ? "These servers have " : "This server has ") + std::to_string(limits.maxSessions) + " sessions, " +
                           (isShared() ? "their" : "its") + " limit; try again later."};
  return std::nullopt;
}

void Directory::sweepSoon() {
  if (sweepSet_ || sessions_.size() <= 1) return;
  sweepSet_ = true;
  using std::chrono::milliseconds;
  const auto pause = std::clamp<milliseconds>(resources_->limits.sessionIdle / 8, milliseconds(10), milliseconds(1000));
  resources_->timer->at(resources_->timer->now() + pause, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->sweep();
  });
}

void Directory::sweep() {
  std::vector<Kept> ended;  // destroyed outside the lock
  {
    const std::lock_guard lock(mutex_);
    sweepSet_ = false;
    const auto now = resources_->timer->now();
    for (auto it = sessions_.begin(); it != sessions_.end();) {
      Kept& kept = it->second;
      const std::uint64_t uses = kept.session->uses();
      if (kept.session->members() > 0 || kept.uses != uses) kept.idleSince.reset();
      kept.uses = uses;
      if (!kept.idleSince && kept.session->members() == 0) kept.idleSince = now;
      const auto most =
          uses || kept.maker.empty() ? resources_->limits.sessionIdle : std::min(resources_->limits.sessionIdle, kUnenteredIdle);
      const bool isOver = kept.idleSince && now - *kept.idleSince >= most && it->first != kDefaultName;
      if (!isOver || !kept.session->end()) {
        ++it;
        continue;
      }
      ended.push_back(std::move(kept));
      it = sessions_.erase(it);
    }
    sweepSoon();
  }
  if (!isShared()) return;
  for (const Kept& kept : ended) worlds_->renew(kept.session->name(), kept.world, kept.epoch, true, [](const auto&) {});
}

}  // namespace ridgecast::directory
