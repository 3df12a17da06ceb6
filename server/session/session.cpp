#include "server/session/session.h"

#include <algorithm>
#include <random>

#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"
#include "server/session/camera_session.h"

namespace ridgecast::session {

namespace {

bool raise(std::atomic<std::uint32_t>& counter, std::uint32_t limit) {
  std::uint32_t now = counter;
  while (now < limit)
    if (counter.compare_exchange_weak(now, now + 1)) return true;
  return false;
}

std::uint64_t anyNumber() {
  std::random_device device;
  return std::uint64_t{device()} << 32 | device();
}

constexpr std::size_t kMaxPast = 16u << 20;  // bytes of edits with which a recording begins

// Null: nobody records, or the ground cannot be told.
std::shared_ptr<recording::Observer> beginRecording(const Resources& resources, const std::string& name, const WorldSpec& spec,
                                                    const terrain::Terrain& terrain, std::uint64_t contentHash, const Edits::Kept& kept) {
  if (!resources.record) return nullptr;
  const auto refuse = [&](const std::string& why) {
    logging::warning({.session = name}, "is not recorded: " + why);
    return nullptr;
  };
  std::vector<recording::Edited> past;
  if (kept.store && kept.store->compacted() > 0) return refuse("edits of its ground were compacted, and cannot be repeated");
  for (std::size_t bytes = 0; kept.store && past.size() < kept.store->last();) {
    auto edits = kept.store->read(past.size(), 1u << 20);
    if (!edits) return refuse(edits.error().message);
    for (Applied& e : *edits) {
      past.push_back({e.number, std::move(e.author), std::move(e.operation)});
      bytes += past.back().operation.size();
    }
    if (bytes > kMaxPast) return refuse("its ground has more than " + std::to_string(kMaxPast >> 20) + " MiB of edits");
  }
  recording::World world{
      name, spec.terrain, spec.seed, spec.parameters, contentHash, static_cast<bool>(terrain.colours()), resources.serverName};
  return resources.record(std::move(world), std::move(past), resources.timer->now());
}

}  // namespace

MakeMesh pipelineMeshes() {
  return [](std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool) {
    return std::make_unique<pipeline::Pipeline>(std::move(terrain), granted, std::move(pool));
  };
}

Session::Session(std::string name, std::shared_ptr<const terrain::Terrain> terrain, WorldSpec spec,
                 std::shared_ptr<const Resources> resources, std::shared_ptr<Places> places, Edits::Kept kept)
    : name_(std::move(name)),
      spec_(std::move(spec)),
      contentHash_(terrain::contentHash(*terrain)),
      nonce_(anyNumber()),
      resources_(std::move(resources)),
      members_(std::make_shared<std::atomic<std::uint32_t>>(0)),
      places_(std::move(places)),
      observer_(beginRecording(*resources_, name_, spec_, *terrain, contentHash_, kept)),
      presence_(std::make_shared<Presence>(*resources_->timer, spec_.clock, observer_)),
      edits_(std::make_shared<Edits>(
          std::move(terrain), *resources_->executor, resources_->writer(), resources_->editSpace,
          [live = live_] {
            for (const auto& camera : live->all()) camera->groundChanged();
          },
          std::move(kept),
          [observer = observer_, resources = resources_](const Applied& made) {
            if (observer) observer->note(resources->timer->now(), recording::Edited{made.number, made.author, made.operation});
          },
          resources_->limits.turn)),
      editPages_(std::make_shared<EditPages>(edits_, *resources_->executor)) {}

std::uint64_t Session::hashOf(const Ground& ground) const {
  return ground.edit == 0 ? contentHash_ : lattice::mix(contentHash_ + ground.edit) ^ nonce_;
}

void Session::edit(Edit edit, std::shared_ptr<Budgets> budgets, std::function<void(const Edits::Answer&)> done) {
  use();
  const auto spent = std::make_shared<std::uint64_t>(0);
  edits_->ask(
      std::move(edit),
      [resources = resources_, budgets, spent, done = std::move(done)](const Edits::Answer& number, std::uint64_t posts) {
        budgets->spendRest(*spent, posts, resources->timer->now());
        done(number);
      },
      [resources = resources_, budgets, spent](const edits::Operation& operation, std::size_t bytes) -> Outcome<void> {
        const auto now = budgets->spendEdit(operation, bytes, resources->timer->now());
        if (!now) return now.error();
        *spent = *now;
        return {};
      });
}

Outcome<CameraPlace> Session::enter(const std::string& client) {
  const Limits& limits = resources_->limits;
  auto onServer = places_->enter();
  if (!onServer) return onServer.error();
  if (!raise(*members_, limits.maxMembers)) {
    if (*members_ & kEnded) return Error{"Session '" + name_ + "' has just ended because it was empty; connect again to create it."};
    return Error{"Session '" + name_ + "' is full: it has " + std::to_string(limits.maxMembers) + " members; try again later."};
  }
  return CameraPlace{
      std::move(*onServer),
      Place(nullptr, [members = members_](const void*) { expects((members->fetch_sub(1) & ~kEnded) > 0, "who leaves was a member"); }),
      budgetsOf(client), client};
}

bool Session::end() {
  std::uint32_t nobody = 0;
  if (!members_->compare_exchange_strong(nobody, kEnded)) return false;
  edits_->end();
  return true;
}

void Session::retire() {
  isRetired_ = true;
  edits_->end();
}

Directory::Directory(std::shared_ptr<const Resources> resources, std::shared_ptr<const terrain::Terrain> defaultTerrain,
                     std::vector<std::pair<std::string, double>> defaultParameters)
    : resources_(std::move(resources)),
      places_(std::make_shared<Places>(resources_->limits.maxCameras, resources_->limits.maxTotalTriangles)),
      reservations_(resources_->state),
      default_{std::move(defaultTerrain), std::move(defaultParameters)} {
  if (auto added = addDefault(); !added && !reservations_.isElsewhere(std::string(kDefaultName))) added.value();
}

Outcome<std::shared_ptr<Session>> Directory::addDefault() { return add(std::string(kDefaultName), default_.terrain, default_.parameters); }

void Directory::awaitDefault() {
  if (find(kDefaultName)) return;
  if (!awaiting_) {
    awaiting_ = resources_->writer().makePool(1);
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
      const auto added = directory->addDefault();
      if (added) return logging::info({.session = std::string(kDefaultName)}, "is this server's now");
      if (directory->reservations_.isElsewhere(std::string(kDefaultName))) return directory->awaitDefault();
      logging::error({.session = std::string(kDefaultName)}, "nobody can enter it: " + added.error().message);
    });
  });
}

std::shared_ptr<Session> Directory::find(std::string_view name) const {
  const std::lock_guard lock(mutex_);
  const auto it = sessions_.find(name);
  return it == sessions_.end() ? nullptr : it->second.session;
}

Outcome<std::unique_ptr<Reservation>> Directory::reserve(const std::string& name) const {
  auto reservation = reservations_.take(name);
  if (reservation && find(name)) reservation->reset();
  return reservation;
}

Outcome<std::shared_ptr<Session>> Directory::add(const std::string& name, std::shared_ptr<const terrain::Terrain> terrain,
                                                 std::vector<std::pair<std::string, double>> parameters, std::string maker,
                                                 wire::ClockMode clock) {
  if (!wire::sessionNameIsValid(name))
    return Error{"A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens."};
  auto reservation = reserve(name);
  if (!reservation) return reservation.error();
  if (!*reservation) return Error{"There is a session named '" + name + "' already; choose another name."};
  return add(std::move(*reservation), std::move(terrain), std::move(parameters), std::move(maker), clock);
}

Outcome<std::shared_ptr<Session>> Directory::add(std::unique_ptr<Reservation> reservation, std::shared_ptr<const terrain::Terrain> terrain,
                                                 std::vector<std::pair<std::string, double>> parameters, std::string maker,
                                                 wire::ClockMode clock) {
  const std::string& name = reservation->name();
  std::sort(parameters.begin(), parameters.end());
  WorldSpec spec{std::string(terrain->name()), terrain->seed(), std::move(parameters), clock};
  auto kept = reservation->keep({spec.terrain, spec.seed, spec.parameters, terrain::contentHash(*terrain)}, terrain);
  if (!kept) return kept.error();
  auto session = std::make_shared<Session>(name, std::move(terrain), std::move(spec), resources_, places_, std::move(*kept));
  const std::lock_guard lock(mutex_);
  if (auto full = fullFor(maker)) return Error{std::move(full->sentence)};
  sessions_.emplace(name, Kept{session, std::move(maker), 0, {}});
  sweepSoon();
  return session;
}

bool Directory::replace(const std::shared_ptr<Session>& session, std::shared_ptr<const terrain::Terrain> terrain,
                        const std::function<void(const Session& successor)>& prepare) {
  auto successor = std::make_shared<Session>(session->name(), std::move(terrain), session->spec(), resources_, places_);
  if (prepare) prepare(*successor);
  const std::lock_guard lock(mutex_);
  const auto it = sessions_.find(session->name());
  if (it == sessions_.end() || it->second.session != session) return false;
  if (session->uses() > 0) successor->use();  // so that it waits for its members as long
  it->second = Kept{std::move(successor), std::move(it->second.maker), 0, {}};
  session->retire();
  return true;
}

std::shared_ptr<Session> Directory::remove(std::string_view name) {
  const std::lock_guard lock(mutex_);
  const auto it = sessions_.find(name);
  if (it == sessions_.end() || name == kDefaultName) return nullptr;
  std::shared_ptr<Session> session = std::move(it->second.session);
  sessions_.erase(it);
  session->retire();
  return session;
}

std::vector<std::shared_ptr<Session>> Directory::all() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<Session>> out;
  for (const auto& [name, kept] : sessions_) out.push_back(kept.session);
  return out;
}

std::optional<Directory::Full> Directory::full(std::string_view maker) const {
  const std::lock_guard lock(mutex_);
  return fullFor(maker);
}

std::optional<Directory::Full> Directory::fullFor(std::string_view maker) const {
  const Limits& limits = resources_->limits;
  const auto made = std::ranges::count_if(sessions_, [&](const auto& entry) { return entry.second.maker == maker; });
  if (!maker.empty() && limits.maxSessionsPerClient != 0 && made >= limits.maxSessionsPerClient)
    return Full{true, "The " + std::string(maker) + " has made " + std::to_string(made) +
                          " of the sessions that live here, the most one client may; leave one until it ends, or join one by its name."};
  if (sessions_.size() >= limits.maxSessions)
    return Full{false, "This server has " + std::to_string(limits.maxSessions) + " sessions, its limit; try again later."};
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
  std::vector<std::shared_ptr<Session>> ended;  // destroyed outside the lock
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
    ended.push_back(std::move(kept.session));
    it = sessions_.erase(it);
  }
  sweepSoon();
}

}  // namespace ridgecast::session
