#include <limits>
#include <vector>

#include "client/c/boundary.h"
#include "common/camera/camera.h"

using namespace ridgecast;
using namespace ridgecast::c;

namespace {

using Milliseconds = std::chrono::milliseconds;

// Runs body(World&) as the only call on this world.
template <class Body>
rc_status alone(rc_world* world, const Body& body) {
  return guarded([&] {
    if (!world) return fail(RC_INVALID, "there is no world, or it was closed");
    const std::lock_guard lock(world->mutex);
    return body(*world->world);
  });
}
template <class Body>
rc_status waiting(rc_world* world, double timeout, const Body& body) {
  const auto wait = milliseconds(timeout);
  if (!wait) return fail(RC_INVALID, wait.error().message);
  return alone(world, [&](world::World& w) { return body(w, *wait); });
}

rc_status statusOf(const world::Result<void>& result) { return result ? RC_OK : fail(result.error()); }

Outcome<lattice::Point> pointOf(double x, double z) {
  const auto atX = query::toSteps(x), atZ = query::toSteps(z);
  if (!atX || !atZ) return (atX ? atZ : atX).error();
  return lattice::Point{*atX, *atZ};
}

using lattice::metres;

world::Options optionsOf(const rc_join_options& given, Milliseconds timeout) {
  world::Options options{.name = given.name ? given.name : "",
                         .camera = given.sensor == 0,
                         .settings = {.threshold = given.threshold, .triangleBudget = given.triangles},
                         .follows = given.follows != 0,
                         .pacing = given.lockstep ? wire::Pacing::kLockstep : wire::Pacing::kFree,
                         .ca = given.ca ? given.ca : "",
                         .token = given.token ? given.token : "",
                         .reconnects = given.stays_lost == 0,
                         .everybody = given.everybody != 0,
                         .terrain = given.terrain ? given.terrain->ground.here() : nullptr,
                         .placesOnly = given.places_only != 0,
                         .errors = given.errors != 0};
  if (timeout.count() > 0) options.timeout = timeout;
  return options;
}

Outcome<camera::Camera> cameraOf(const rc_camera& given) {
  const auto at = pointOf(given.x, given.z);
  if (!at) return at.error();
  camera::Camera camera;
  camera.pose = {.x = at->x, .z = at->z, .y = given.y, .yaw = given.yaw, .pitch = given.pitch};
  if (given.vertical_fov != 0) camera.projection.verticalFov = given.vertical_fov;
  if (given.width != 0) camera.projection.width = given.width;
  if (given.height != 0) camera.projection.height = given.height;
  return camera;
}

std::span<const std::uint8_t> stateOf(const rc_camera& given) { return {given.state, given.state ? given.state_size : 0}; }

void writeIteration(const world::World& world, const link::Update& update, rc_iteration* out) {
  if (!out) return;
  const wire::Iteration& iteration = update.iteration;
  write({.number = iteration.number,
         .pose = iteration.poseSequence,
         .hash = world.scene().hash(),
         .triangles = world.scene().triangles(),
         .threshold = iteration.figures.effectiveThreshold,
         .settled = iteration.settled},
        out);
}

}  // namespace

rc_status rc_join(const char* url, const rc_join_options* options, rc_world** out) {
  return guarded([&] {
    if (!url || !out) return fail(RC_INVALID, "a world needs a URL, and a place for its handle");
    if (options && !hasSize(options)) return noSize("rc_join_options");
    const rc_join_options given = read(options);
    const auto timeout = milliseconds(given.timeout);
    if (!timeout) return fail(RC_INVALID, timeout.error().message);
    if (given.terrain && given.terrain->world) return fail(RC_INVALID, "a world's terrain here is one of rc_terrain_open");
    auto joined = world::World::join(url, optionsOf(given, *timeout));
    if (!joined) return fail(joined.error());
    const query::Ground ground = (*joined)->terrain();
    auto world = std::unique_ptr<rc_world>(new rc_world{std::move(*joined), {ground}});
    world->terrain.world = world.get();
    *out = world.release();
    return RC_OK;
  });
}

void rc_world_close(rc_world* world) { delete world; }

rc_terrain* rc_world_terrain(rc_world* world) { return world ? &world->terrain : nullptr; }

rc_status rc_world_get_info(rc_world* world, rc_world_info* out) {
  return alone(world, [&](const world::World& w) {
    if (!out || !hasSize(out)) return noSize("rc_world_info");
    const wire::World& info = w.info();
    write({.session = info.session.c_str(),
           .terrain = info.terrainName.c_str(),
           .server = info.serverName.c_str(),
           .hash = w.terrain().hash(),
           .member = w.camera(),
           .reconnections = w.reconnections(),
           .horizon = info.horizon,
           .seed = info.seed,
           .is_local = w.isLocal()},
          out);
    return RC_OK;
  });
}

rc_status rc_world_ground(rc_world* world, double x, double z, double radius, double error, double timeout, const rc_mesh** out) {
  return waiting(world, timeout, [&](world::World& w, Milliseconds wait) {
    const auto at = pointOf(x, z);
    if (!at || !out) return fail(RC_INVALID, at ? "a mesh needs a place for its handle" : at.error().message);
    auto mesh = w.ground(*at, radius, error, wait);
    if (!mesh) return fail(mesh.error());
    *out = made(std::move(*mesh));
    return RC_OK;
  });
}

rc_status rc_world_clock(rc_world* world, rc_clock* out) {
  return alone(world, [&](world::World& w) {
    if (!out || !hasSize(out)) return noSize("rc_clock");
    const auto clock = w.clock();
    const auto now = std::chrono::steady_clock::now();
    const wire::Clock& said = clock.said();
    write({.time = static_cast<std::int64_t>(clock.time(now)),
           .uncertainty = clock.uncertainty(now).count(),
           .owner = said.owner,
           .step = said.step,
           .rate = said.rate,
           .mode = static_cast<std::int32_t>(said.mode),
           .end = static_cast<std::int64_t>(said.end)},
          out);
    return RC_OK;
  });
}

rc_status rc_world_set_clock(rc_world* world, int32_t mode, double rate, double timeout) {
  return waiting(world, timeout, [&](world::World& w, Milliseconds wait) {
    if (mode < RC_REAL_TIME || mode > RC_STEPPED) return fail(RC_INVALID, "a clock is RC_REAL_TIME, RC_SCALED or RC_STEPPED");
    if (mode == RC_SCALED && !(rate > 0 && rate <= 1000)) return fail(RC_INVALID, "a clock's rate is above 0 and at most 1000");
    return statusOf(w.setClock(static_cast<wire::ClockMode>(mode), mode == RC_SCALED ? rate : 1, wait));
  });
}

rc_status rc_world_jump(rc_world* world, int64_t time, double timeout) {
  return waiting(world, timeout,
                 [&](world::World& w, Milliseconds wait) { return statusOf(w.jump(std::chrono::microseconds(time), wait)); });
}

rc_status rc_world_step(rc_world* world, int64_t time, double timeout) {
  return waiting(world, timeout,
                 [&](world::World& w, Milliseconds wait) { return statusOf(w.step(std::chrono::microseconds(time), wait)); });
}

rc_status rc_world_next_step(rc_world* world, double timeout, int64_t* time) {
  return waiting(world, timeout, [&](world::World& w, Milliseconds wait) {
    const auto next = w.nextStep(wait);
    if (!next) return fail(next.error());
    if (time) *time = static_cast<std::int64_t>(*next);
    return RC_OK;
  });
}

rc_status rc_world_pass_over(rc_world* world, uint64_t member) {
  return alone(world, [&](world::World& w) {
    w.passOver(member);
    return RC_OK;
  });
}

rc_status rc_world_edit(rc_world* world, const char* operation, const char* key, double timeout, uint64_t* number) {
  return waiting(world, timeout, [&](world::World& w, Milliseconds wait) {
    if (!operation) return fail(RC_INVALID, "an edit is a JSON object, not null");
    const auto made = w.edit(operation, key ? key : "", wait);
    if (!made) return fail(made.error());
    if (number) *number = *made;
    return RC_OK;
  });
}

rc_status rc_world_fly(rc_world* world, const rc_camera* camera, double timeout, rc_iteration* out) {
  return waiting(world, timeout, [&](world::World& w, Milliseconds wait) {
    if (!camera || !hasSize(camera)) return noSize("rc_camera");
    if (out && !hasSize(out)) return noSize("rc_iteration");
    const rc_camera given = read(camera);
    const auto asked = cameraOf(given);
    if (!asked) return fail(RC_INVALID, asked.error().message);
    if (wait.count() == 0) {
      const auto sent = w.send(*asked, stateOf(given));
      if (sent && out) write({.pose = *sent}, out);
      return sent ? RC_OK : fail(sent.error());
    }
    const auto update = w.fly(*asked, wait, stateOf(given));
    if (!update) return fail(update.error());
    writeIteration(w, *update, out);
    return RC_OK;
  });
}

rc_status rc_world_receive(rc_world* world, double timeout, rc_iteration* out) {
  return waiting(world, timeout, [&](world::World& w, Milliseconds wait) {
    if (out && !hasSize(out)) return noSize("rc_iteration");
    const auto update = w.receive(wait);
    if (!update) return fail(update.error());
    writeIteration(w, *update, out);
    return RC_OK;
  });
}

rc_status rc_world_mesh(rc_world* world, double x, double z, const rc_mesh** out) {
  return alone(world, [&](const world::World& w) {
    const auto origin = pointOf(x, z);
    if (!origin || !out) return fail(RC_INVALID, origin ? "a mesh needs a place for its handle" : origin.error().message);
    *out = made(world::meshOf(w.scene().leaves(), *origin));
    return RC_OK;
  });
}

rc_status rc_world_leaves(rc_world* world, rc_leaf* out, size_t room, size_t* count) {
  return alone(world, [&](const world::World& w) {
    std::vector<rc_leaf> all;
    for (const auto& [address, leaf] : w.scene().index())
      all.push_back({.i = address.i,
                     .j = address.j,
                     .side = metres(address.side()),
                     .version = leaf.version,
                     .triangles = leaf.triangles,
                     .level = address.level});
    return writeAll(all, out, room, count, "rc_leaf");
  });
}

rc_status rc_world_leaf(rc_world* world, int32_t level, int64_t i, int64_t j, const rc_mesh** out) {
  return alone(world, [&](const world::World& w) {
    const lattice::LeafAddress address{level, i, j};
    const core::HeldLeaf* const leaf = w.scene().leaf(address);
    if (!leaf || !out) return fail(RC_INVALID, "there is no such leaf now: rc_world_leaves lists them");
    *out = made(world::meshOf({{address, *leaf}}, {address.x(), address.z()}));
    return RC_OK;
  });
}

rc_status rc_world_members(rc_world* world, rc_member* out, size_t room, size_t* count) {
  return alone(world, [&](world::World& w) {
    std::vector<rc_member> all;
    for (const core::Other& other : w.others()) {
      rc_member member{.member = other.member.camera, .sensor = other.member.role == wire::Role::kSensor};
      const std::string& name = other.member.name;
      std::copy_n(name.begin(), std::min(name.size(), sizeof member.name - 1), member.name);
      if (const auto& moved = other.member.moved) {
        const camera::Pose& pose = moved->pose.camera.pose;
        member.has_pose = 1;
        member.time = static_cast<std::int64_t>(moved->time);
        const auto& state = moved->pose.state;
        member.state_size = static_cast<std::uint32_t>(std::min(state.size(), sizeof member.state));
        std::copy_n(state.begin(), member.state_size, member.state);
        member.x = metres(pose.x), member.y = pose.y, member.z = metres(pose.z), member.yaw = pose.yaw, member.pitch = pose.pitch;
      }
      all.push_back(member);
    }
    return writeAll(all, out, room, count, "rc_member");
  });
}

rc_status rc_world_crowd(rc_world* world, rc_crowd_cell* out, size_t room, size_t* count, uint64_t* others) {
  return alone(world, [&](world::World& w) {
    const core::Roster roster = w.roster();
    const wire::Crowd& crowd = roster.crowd();
    const double side = std::ldexp(256, static_cast<int>(crowd.level));
    std::vector<rc_crowd_cell> cells;
    for (std::size_t k = 0; k < crowd.i.size(); ++k)
      cells.push_back({.x = static_cast<double>(crowd.i[k]) * side,
                       .z = static_cast<double>(crowd.j[k]) * side,
                       .side = side,
                       .members = crowd.count[k]});
    if (others) *others = roster.count();
    return writeAll(cells, out, room, count, "rc_crowd_cell");
  });
}
