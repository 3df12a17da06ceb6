#include "server/directory/shared_worlds.h"

#include <map>

#include "common/outcome/contract.h"
#include "common/text/text.h"

namespace ridgecast::directory {

namespace {

// With a slash, which no name has: one key's prefix is no other's.
std::string worldKey(const std::string& name) { return "world/" + name + "/"; }
std::string keptKey(const std::string& name) { return "kept/" + name + "/"; }
constexpr std::string_view kEnded = "ended/";
std::string endedKey(const std::string& name, const std::string& id) { return std::string(kEnded) + name + "/" + id + "/"; }

using Records = std::map<std::string, bus::Record>;

// What the only record says; nothing: there is none.
Outcome<std::optional<SharedWorlds::Standing>> theOne(const Outcome<Records>& records) {
  if (!records) return records.error();
  if (records->empty()) return std::optional<SharedWorlds::Standing>();
  const bus::Record& record = records->begin()->second;
  auto world = worldOf(record.value);
  if (!world) return world.error();
  return std::optional(SharedWorlds::Standing{std::move(*world), record.epoch});
}

// `own`: stands next time, if none does and the engine has forgotten its epoch.
std::function<void(Outcome<bus::Bus::Held>)> standing(const World& own, std::function<void(Outcome<SharedWorlds::Standing>)> done) {
  return [own, done = std::move(done)](const Outcome<bus::Bus::Held>& held) {
    if (!held) return done(held.error());
    if (held->record.value.empty()) return done(SharedWorlds::Standing{own, 0});
    auto world = worldOf(held->record.value);
    if (!world) return done(world.error());
    done(SharedWorlds::Standing{std::move(*world), held->record.epoch});
  };
}

}  // namespace

SharedWorlds::SharedWorlds(std::shared_ptr<bus::Bus> bus, std::chrono::milliseconds life) : bus_(std::move(bus)), life_(life) {
  expects(bus_ && life_ >= kGrace, "records outlive a moment without renewals");
}

void SharedWorlds::find(const std::string& name, std::function<void(Outcome<Found>)> done) const {
  bus_->list(worldKey(name), [bus = bus_, name, done = std::move(done)](const Outcome<Records>& records) {
    auto live = theOne(records);
    if (!live) return done(live.error());
    const auto findKept = [bus, name, done] {
      bus->list(keptKey(name), [done](const Outcome<Records>& kept) {
        auto its = theOne(kept);
        if (!its) return done(its.error());
        done(Found{{}, *its ? std::optional(std::move((*its)->world)) : std::nullopt});
      });
    };
    if (!*live) return findKept();
    bus->list(endedKey(name, (*live)->world.id), [bus, name, done, findKept, live = std::move(**live)](const Outcome<Records>& ended) {
      if (!ended) return done(ended.error());
      if (ended->empty()) return done(Found{live, {}});
      bus->drop(worldKey(name), live.epoch);  // a server renewed it before it heard
      findKept();
    });
  });
}

void SharedWorlds::claim(const std::string& name, const World& world, std::function<void(Outcome<Standing>)> done) const {
  bus_->hold(worldKey(name), toText(world), 0, kGrace, standing(world, std::move(done)));
}

void SharedWorlds::renew(const std::string& name, const World& world, std::uint64_t epoch, bool isBrief,
                         std::function<void(Outcome<Standing>)> done) const {
  bus_->hold(worldKey(name), toText(world), epoch, isBrief ? kGrace : life_, standing(world, std::move(done)));
}

void SharedWorlds::keep(const std::string& name, const World& world, std::function<void(Outcome<World>)> done) const {
  // Not whose session it was, nor how its clock began.
  const World ground{{}, {world.spec.terrain, world.spec.seed, world.spec.parameters}, world.contentHash, {}};
  bus_->hold(keptKey(name), toText(ground), 0, std::chrono::milliseconds(0),
             standing(ground, [done = std::move(done)](Outcome<Standing> stands) {
               stands ? done(std::move(stands->world)) : done(stands.error());
             }));
}

void SharedWorlds::end(const std::string& name, const std::string& id, std::uint64_t epoch) const {
  bus_->hold(endedKey(name, id), "ended", 0, life_, [](const auto&) {});
  bus_->drop(worldKey(name), epoch);
}

void SharedWorlds::listEnded(std::function<void(Outcome<Ended>)> done) const {
  bus_->list(std::string(kEnded), [done = std::move(done)](const Outcome<Records>& records) {
    if (!records) return done(records.error());
    Ended ended;
    for (const auto& [key, record] : *records) {
      std::string_view rest = std::string_view(key).substr(kEnded.size());
      const std::string name(text::takePart(rest, '/'));
      ended.emplace(name, std::string(text::takePart(rest, '/')));
    }
    done(std::move(ended));
  });
}

}  // namespace ridgecast::directory
