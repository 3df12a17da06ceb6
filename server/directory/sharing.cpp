// What a directory tells other servers, and hears of them.
#include <algorithm>

#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "server/directory/directory.h"
#include "server/logging/logging.h"

namespace ridgecast::directory {

namespace {

constexpr std::string_view kServers = "server/";
constexpr const char* kRemovals = "directory/removals";  // SERVER NAME CAMERA
constexpr const char* kSpent = "directory/spent";        // a line each: five AMOUNTs, CLIENT
constexpr std::uint64_t kRenewEvery = 2;                 // ticks

logging::About about(const std::string& session, std::string_view event) { return {.session = session, .event = event}; }

}  // namespace

World Directory::propose(session::WorldSpec spec, const terrain::Terrain& terrain, std::string maker) {
  return {worlds_->newId(), std::move(spec), terrain::contentHash(terrain), std::move(maker)};
}

World Directory::defaultWorld(const terrain::Terrain& terrain, std::vector<std::pair<std::string, double>> parameters) {
  std::sort(parameters.begin(), parameters.end());
  return {
      std::string(kDefaultName), {std::string(terrain.name()), terrain.seed(), std::move(parameters)}, terrain::contentHash(terrain), {}};
}

void Directory::claimDefault(const session::Resources& resources, const terrain::Terrain& terrain,
                             std::vector<std::pair<std::string, double>> parameters, std::function<void(Outcome<void>)> done) {
  const auto worlds = std::make_shared<const SharedWorlds>(resources.bus, kGrace);
  const auto judge = [own = defaultWorld(terrain, std::move(parameters))](const World& theirs, const std::string& remedy) -> Outcome<void> {
    if (theirs.hasGroundOf(own)) return {};
    return Error{"The session 'default' is another world on this server (" + describe(own) + ") than on the others (" + describe(theirs) +
                 "); start all with the same terrain, parameters and files, " + remedy + "."};
  };
  const std::string name(kDefaultName);
  worlds->find(name, [=, own = defaultWorld(terrain, parameters), done = std::move(done)](Outcome<SharedWorlds::Found> found) {
    if (!found) return done(found.error());
    if (found->kept)
      if (auto judged = judge(*found->kept, "or remove its edits from the engine"); !judged) return done(judged);
    worlds->claim(name, own, [=](Outcome<SharedWorlds::Standing> stands) {
      if (!stands) return done(stands.error());
      done(judge(stands->world, "or wait until the others have been gone for 10 seconds"));
    });
  });
}

void Directory::join(Host host) {
  if (!isShared()) return;
  expects(host.load && host.entry && host.remove && host.sendAway && host.leave && !host_.load, "a directory has one host");
  host_ = std::move(host);
  hearing_ = resources_->executor->makePool(1);
  heard_.push_back(resources_->bus->hear(kRemovals, [weak = weak_from_this()](const std::string& message) {
    const auto self = weak.lock();
    std::string_view rest = message;
    const auto number = text::number<std::uint32_t>(text::takePart(rest, ' '));
    if (!self || number != self->resources_->bus->server()) return;
    const auto session = self->find(text::takePart(rest, ' '));
    const auto camera = text::number<std::uint64_t>(rest);
    if (session && camera) self->host_.remove(*session, *camera);
  }));
  heard_.push_back(resources_->bus->hear(kSpent, [weak = weak_from_this()](const std::string& message) {
    const auto self = weak.lock();
    if (!self) return;
    for (std::string_view rest = message; !rest.empty();) {
      std::string_view line = text::takePart(rest, '\n');
      session::Spent spent;
      for (auto& amount : spent.amounts) amount = text::number<std::uint64_t>(text::takePart(line, ' ')).value_or(0);
      spent.client = line;
      self->resources_->budgets->charge(spent, self->resources_->timer->now());
    }
  }));
  tick();
}

void Directory::tick() {
  resources_->timer->at(resources_->timer->now() + kTellEvery, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->tick();
  });
  tellOfItself();
  hearOfServers();
  hearOfEnded();
  tellSpent();
  const bool renews = ticks_++ % kRenewEvery == 0;
  Sessions sessions;
  {
    const std::lock_guard lock(mutex_);
    sessions = sessions_;
  }
  for (const auto& [name, kept] : sessions) {
    if (renews) renew(name, kept);
    if (!kept.isKept && kept.session->ground().edit > 0) keepWorld(name, kept);
  }
}

ServerStatus Directory::self() const {
  expects(host_.load != nullptr, "a server tells of itself once it has joined the others");
  return {resources_->bus->server(), host_.url, cameras(), triangles(), host_.load(), {}};
}

void Directory::tellOfItself() {
  ServerStatus status = self();
  Sessions sessions;
  std::uint64_t epoch = 0;
  {
    const std::lock_guard lock(mutex_);
    sessions = sessions_;
    epoch = epoch_;
  }
  for (const auto& [name, kept] : sessions)
    status.sessions[name] = {kept.world, kept.epoch, kept.session->members(), host_.entry(*kept.session)};
  resources_->bus->hold(std::string(kServers) + std::to_string(status.number), toText(status), epoch, kServerLife,
                        [weak = weak_from_this()](const Outcome<bus::Bus::Held>& held) {
                          const auto self = weak.lock();
                          if (!self || !held) return;
                          const std::lock_guard lock(self->mutex_);
                          self->epoch_ = held->record.epoch;
                        });
}

void Directory::hearOfServers() {
  resources_->bus->list(std::string(kServers), [weak = weak_from_this()](Outcome<std::map<std::string, bus::Record>> records) {
    const auto self = weak.lock();
    if (!self || !records) return;
    self->hearing_->post([weak, records = std::move(*records)] {  // the bus's thread has other things to do
      if (const auto directory = weak.lock()) directory->heardOfServers(records);
    });
  });
}

void Directory::heardOfServers(const std::map<std::string, bus::Record>& records) {
  auto others = std::make_shared<std::vector<ServerStatus>>();
  for (const auto& [key, record] : records) {
    if (key == std::string(kServers) + std::to_string(resources_->bus->server())) continue;
    auto status = statusOf(record.value);
    status ? others->push_back(std::move(*status)) : logging::warning(status.error().message);
  }
  const std::lock_guard lock(mutex_);
  others_ = std::move(others);
  for (const auto& [name, kept] : sessions_) {
    std::uint32_t members = 0;
    for (const ServerStatus& server : *others_)
      if (const auto there = server.sessions.find(name); there != server.sessions.end()) members += there->second.members;
    kept.session->setMembersElsewhere(members);
  }
}

void Directory::hearOfEnded() {
  worlds_->listEnded([weak = weak_from_this()](const Outcome<SharedWorlds::Ended>& ended) {
    const auto self = weak.lock();
    if (!self || !ended) return;
    std::vector<Kept> over;
    {
      const std::lock_guard lock(self->mutex_);
      for (const auto& [name, id] : *ended) {
        const auto it = self->sessions_.find(name);
        if (it == self->sessions_.end() || it->second.world.id != id) continue;
        over.push_back(it->second);
        it->second.session->clock().end();
        self->take(it);
      }
    }
    for (const Kept& kept : over) {
      logging::info(about(kept.session->name(), "ended"), "was ended at another server; its members are sent away");
      self->worlds_->end(kept.session->name(), kept.world.id, kept.epoch);
      self->host_.remove(*kept.session, {});
    }
  });
}

void Directory::tellSpent() {
  std::string message;
  for (const session::Spent& spent : resources_->budgets->takeSpent()) {
    for (const std::uint64_t amount : spent.amounts) message += std::to_string(amount) + " ";
    message += spent.client + "\n";
  }
  if (!message.empty()) resources_->bus->tell(kSpent, std::move(message));
}

void Directory::renew(const std::string& name, const Kept& kept) {
  worlds_->renew(name, kept.world, kept.epoch, name == kDefaultName,
                 [weak = weak_from_this(), name, session = std::weak_ptr(kept.session)](const Outcome<SharedWorlds::Standing>& stands) {
                   const auto self = weak.lock();
                   if (self && stands) self->renewed(name, session.lock().get(), *stands);
                 });
}

void Directory::renewed(const std::string& name, const session::Session* session, const SharedWorlds::Standing& stands) {
  std::shared_ptr<session::Session> other;  // whose name is another world's
  {
    const std::lock_guard lock(mutex_);
    const auto it = sessions_.find(name);
    if (!session || it == sessions_.end() || it->second.session.get() != session) return;
    Kept& kept = it->second;
    if (stands.world.id == kept.world.id && stands.world.hasGroundOf(kept.world)) {
      kept.epoch = stands.epoch;
      return;
    }
    if (name != kDefaultName) other = take(it);
  }
  if (other) {
    logging::warning(about(name, "ended"), "is another world on the other servers (" + describe(stands.world) +
                                               "): this one had lost touch with them; its members connect again");
    return host_.sendAway(*other);
  }
  logging::error(about(name, "ended"), "is another world on the other servers (" + describe(stands.world) +
                                           "): this one leaves; start it with the same terrain, parameters and files");
  host_.leave();
}

session::Session::Claim Directory::claimOf(const std::string& name, const World& world) const {
  return [worlds = worlds_, name, world](std::function<void(Outcome<void>)> done) {
    worlds->keep(name, world, [name, world, done = std::move(done)](const Outcome<World>& stands) {
      if (!stands) return done(stands.error());
      if (!stands->hasGroundOf(world))
        return done(Error{"The session '" + name + "' has edits of another world, " + describe(*stands) + "; choose another name."});
      done({});
    });
  };
}

void Directory::keepWorld(const std::string& name, const Kept& kept) {
  claimOf(name, kept.world)([weak = weak_from_this(), name, session = std::weak_ptr(kept.session)](const Outcome<void>& claimed) {
    const auto self = weak.lock();
    if (!self || (!claimed && self->resources_->bus->isAway())) return;
    if (!claimed) logging::error(about(name, "edits"), claimed.error().message);  // once
    const std::lock_guard lock(self->mutex_);
    const auto it = self->sessions_.find(name);
    if (it != self->sessions_.end() && it->second.session == session.lock()) it->second.isKept = true;
  });
}

std::shared_ptr<const std::vector<ServerStatus>> Directory::others() const {
  const std::lock_guard lock(mutex_);
  return others_;
}

const ServerStatus::Session* Directory::find(const std::vector<ServerStatus>& servers, std::string_view name) {
  for (const ServerStatus& server : servers)
    if (const auto it = server.sessions.find(name); it != server.sessions.end()) return &it->second;
  return nullptr;
}

bool Directory::removeElsewhere(const std::string& name) {
  const auto servers = others();
  const auto* session = find(*servers, name);
  if (!session || name == kDefaultName) return false;
  worlds_->end(name, session->world.id, session->epoch);
  return true;
}

std::shared_ptr<const ServerStatus> Directory::serverOf(const std::string& session, std::uint64_t camera) const {
  const auto servers = others();
  const auto its = std::ranges::find(*servers, camera >> 32, &ServerStatus::number);
  if (its == servers->end() || !its->sessions.contains(session)) return nullptr;
  return {servers, &*its};
}

bool Directory::removeElsewhere(const std::string& name, std::uint64_t camera) {
  const auto server = serverOf(name, camera);
  if (server) resources_->bus->tell(kRemovals, std::to_string(server->number) + " " + name + " " + std::to_string(camera));
  return server != nullptr;
}

}  // namespace ridgecast::directory
