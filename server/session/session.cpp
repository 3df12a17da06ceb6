#include "server/session/session.h"

#include <utility>

#include "common/wire/wire.h"

namespace ridgecast::session {

namespace {

bool raise(std::atomic<std::uint32_t>& counter, std::uint32_t limit) {
  std::uint32_t now = counter;
  while (now < limit)
    if (counter.compare_exchange_weak(now, now + 1)) return true;
  return false;
}

}  // namespace

Session::Session(std::string name, std::shared_ptr<const terrain::Terrain> terrain, std::shared_ptr<const Resources> resources,
                 std::shared_ptr<std::atomic<std::uint32_t>> cameras)
    : name_(std::move(name)),
      terrain_(std::move(terrain)),
      contentHash_(terrain::contentHash(*terrain_)),
      resources_(std::move(resources)),
      members_(std::make_shared<std::atomic<std::uint32_t>>(0)),
      cameras_(std::move(cameras)),
      presence_(std::make_shared<Presence>(resources_->alarm)) {}

Outcome<Place> Session::enter() {
  const Limits& limits = resources_->limits;
  if (!raise(*cameras_, limits.maxCameras))
    return Error{"This server is full: it serves " + std::to_string(limits.maxCameras) + " cameras; try again later."};
  if (!raise(*members_, limits.maxMembers)) {
    --*cameras_;
    return Error{"Session '" + name_ + "' is full: it has " + std::to_string(limits.maxMembers) + " members; try again later."};
  }
  return Place(members_, cameras_);
}

Directory::Directory(std::shared_ptr<const Resources> resources, std::shared_ptr<const terrain::Terrain> defaultTerrain)
    : resources_(std::move(resources)) {
  const std::string name(kDefaultName);
  sessions_[name] = std::make_shared<Session>(name, std::move(defaultTerrain), resources_, cameras_);
}

std::shared_ptr<Session> Directory::find(std::string_view name) const {
  const std::lock_guard lock(mutex_);
  const auto it = sessions_.find(std::string(name));
  return it == sessions_.end() ? nullptr : it->second;
}

Outcome<std::shared_ptr<Session>> Directory::add(std::string name, std::shared_ptr<const terrain::Terrain> terrain) {
  if (!wire::sessionNameIsValid(name))
    return Error{"A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens."};
  auto session = std::make_shared<Session>(name, std::move(terrain), resources_, cameras_);
  const std::lock_guard lock(mutex_);
  if (!sessions_.emplace(name, session).second) return Error{"There is a session named '" + name + "' already; choose another name."};
  return session;
}

}  // namespace ridgecast::session
