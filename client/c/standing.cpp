#include "client/standing/standing_ground.h"

#include <deque>
#include <vector>

#include "client/c/boundary.h"

struct rc_standing {
  std::unique_ptr<ridgecast::standing::StandingGround> ground;
  std::deque<std::pair<std::shared_ptr<const ridgecast::standing::Tile>, bool>> untold;     // and whether it is gone
  std::unordered_map<const float*, std::shared_ptr<const ridgecast::standing::Tile>> held;  // that the program may use
  std::vector<std::shared_ptr<const ridgecast::standing::Tile>> going;                      // until the next call
};

using namespace ridgecast;
using namespace ridgecast::c;

rc_status rc_standing_open(rc_terrain* terrain, const rc_standing_options* options, rc_standing** out) {
  return guarded([&] {
    if (!terrain || !out) return fail(RC_INVALID, "ground needs a terrain, and a place for its handle");
    if (options && !hasSize(options)) return noSize("rc_standing_options");
    const rc_standing_options given = read(options);
    standing::StandingGround::Options wanted;
    const double spacing = given.spacing == 0 ? 1 : given.spacing, radius = given.radius == 0 ? 32 * spacing : given.radius;
    const auto spacingSteps = query::toSteps(spacing), radiusSteps = query::toSteps(radius);
    if (!spacingSteps || !radiusSteps || static_cast<double>(*spacingSteps) != spacing * lattice::kStepsPerMetre)
      return fail(RC_INVALID, "heights are 1/64 to 4096 metres apart, in steps of 1/64 m");
    wanted.spacing = *spacingSteps;
    wanted.radius = *radiusSteps;
    if (given.memory > 0) wanted.memory = given.memory;
    auto ground = standing::StandingGround::open(standing::sourceOf(terrain->ground), wanted);  // beside the world's calls
    if (!ground) return fail(RC_INVALID, ground.error().message);
    *out = new rc_standing{std::move(*ground), {}, {}, {}};
    return RC_OK;
  });
}

void rc_standing_close(rc_standing* standing) { delete standing; }

rc_status rc_standing_move(rc_standing* standing, const double* places, size_t count) {
  return guarded([&] {
    if (!standing || (count > 0 && !places)) return fail(RC_INVALID, "there is no ground, or there are no places");
    if (count > standing::kMaxBodies) return fail(RC_INVALID, "there is ground for at most 100000 bodies");
    std::vector<lattice::Point> bodies(count);
    for (std::size_t k = 0; k < count; ++k) {
      const auto x = query::toSteps(places[2 * k]), z = query::toSteps(places[2 * k + 1]);
      if (!x || !z) return fail(RC_INVALID, "body " + std::to_string(k) + " is not a pair of numbers within 4.398e12 m of the origin");
      bodies[k] = {*x, *z};
    }
    const auto moved = standing->ground->move(bodies);
    return moved ? RC_OK : fail(RC_INVALID, moved.error().message);
  });
}

rc_status rc_standing_ready(rc_standing* standing, size_t count, uint8_t* ready) {
  return guarded([&] {
    if (!standing || (count > 0 && !ready)) return fail(RC_INVALID, "there is no ground, or no room");
    if (count != standing->ground->bodies())
      return fail(RC_INVALID, "there are " + std::to_string(standing->ground->bodies()) + " bodies, not " + std::to_string(count));
    standing->ground->ready({ready, count});
    return RC_OK;
  });
}

rc_status rc_standing_wait(rc_standing* standing, double timeout) {
  return guarded([&] {
    const auto wait = milliseconds(timeout);
    if (!standing || !wait) return fail(RC_INVALID, standing ? wait.error().message : "there is no ground");
    const auto there = standing->ground->wait(*wait);
    return there ? RC_OK : fail(standing->ground->full() ? RC_INVALID : RC_TIMEOUT, there.error().message);
  });
}

rc_status rc_standing_changes(rc_standing* standing, rc_tile* out, size_t room, size_t* count) {
  return guarded([&] {
    if (!standing) return fail(RC_INVALID, "there is no ground");
    standing->going.clear();
    if (standing->untold.empty()) {  // so that what is not read does not grow
      standing::Changes changes = standing->ground->changes();
      for (auto& tile : changes.gone) standing->untold.emplace_back(std::move(tile), true);
      for (auto& tile : changes.came) standing->untold.emplace_back(std::move(tile), false);
    }
    std::vector<rc_tile> all;
    const auto metres = [](lattice::Step steps) { return static_cast<double>(steps) * lattice::kMetresPerStep; };
    for (const auto& [tile, gone] : standing->untold) {
      if (all.size() == room) break;
      all.push_back({.i = tile->i,
                     .j = tile->j,
                     .version = tile->version,
                     .heights = tile->heights.data(),
                     .x = metres(tile->x()),
                     .z = metres(tile->z()),
                     .spacing = metres(tile->spacing),
                     .error = tile->error,
                     .lowest = tile->lowest,
                     .highest = tile->highest,
                     .gone = gone,
                     .edit = tile->edit});
    }
    const rc_status status = writeAll(all, out, room, count, "rc_tile");
    if (status != RC_OK) return status;
    *count = standing->untold.size();
    for (std::size_t k = 0; k < all.size(); ++k) {
      auto [tile, gone] = std::move(standing->untold.front());
      standing->untold.pop_front();
      if (gone) {
        standing->held.erase(tile->heights.data());
        standing->going.push_back(std::move(tile));
      } else {
        standing->held.emplace(tile->heights.data(), std::move(tile));
      }
    }
    return RC_OK;
  });
}
