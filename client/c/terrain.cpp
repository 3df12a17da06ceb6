#include <cmath>
#include <cstdint>
#include <vector>

#include "client/c/boundary.h"
#include "common/ground/ground.h"
#include "common/process/child.h"
#include "common/terrain/materials.h"
#include "common/user_terrain/catalogue.h"

namespace ridgecast::c {

namespace {

constexpr std::size_t kPart = 4096;  // places at a time, where they are computed here: their steps stay in the cache

rc_status beyond(std::size_t place) {
  return fail(RC_INVALID, "place " + std::to_string(place) + " is not a pair of numbers within 4.398e12 m of the origin");
}

struct Place {
  double x, z;
};

// std::floor is a call.
lattice::Step floorOf(double value) {
  const auto towardsZero = static_cast<lattice::Step>(value);
  return towardsZero - (static_cast<double>(towardsZero) > value ? 1 : 0);
}

// Calls body(x, z, first) for parts of the places, which are asked in order; first: how many were before.
template <class At, class Body>
rc_status eachPart(const rc_terrain& terrain, std::size_t count, At placeAt, const Body& body) {
  const std::size_t part = terrain.isAsked() ? count : std::min(count, kPart);
  std::vector<lattice::Step> x(part), z(part);
  for (std::size_t first = 0; first < count; first += part) {
    const std::size_t n = std::min(part, count - first);
    for (std::size_t k = 0; k < n; ++k) {
      const Place place = placeAt(first + k);
      const double atX = place.x * lattice::kStepsPerMetre + 0.5, atZ = place.z * lattice::kStepsPerMetre + 0.5;
      constexpr double kFirst = -lattice::kMaxPosition, kEnd = lattice::kMaxPosition + 1;
      if (!(atX >= kFirst && atX < kEnd && atZ >= kFirst && atZ < kEnd)) return beyond(first + k);
      x[k] = floorOf(atX);
      z[k] = floorOf(atZ);
    }
    if (const rc_status status = body(std::span(x).first(n), std::span(z).first(n), first); status != RC_OK) return status;
  }
  return RC_OK;
}

auto eachOf(const double* places) {
  return [places](std::size_t k) { return Place{places[2 * k], places[2 * k + 1]}; };
}

// By the terrain itself, or by its world, whose calls take turns.
template <class Here, class There>
rc_status answer(const rc_terrain& terrain, const Here& here, const There& there) {
  if (!terrain.isAsked()) {
    const Outcome<void> known = here(terrain.ground);
    return known ? RC_OK : fail(RC_INVALID, known.error().message);
  }
  const std::lock_guard lock(terrain.world->mutex);
  const world::Result<void> known = there(*terrain.world->world);
  return known ? RC_OK : fail(known.error());
}

template <class At>
rc_status heightsOf(const rc_terrain& terrain, std::size_t count, const At& placeAt, float* heights) {
  return eachPart(terrain, count, placeAt, [&](auto x, auto z, std::size_t first) {
    const std::span out(heights + first, x.size());
    return answer(
        terrain, [&](auto& ground) { return ground.heights(x, z, out); }, [&](auto& world) { return world.heights(x, z, out); });
  });
}

Outcome<user_terrain::Request> requestOf(const char* name, const rc_terrain_options& options) {
  user_terrain::Request request;
  request.terrain = name;
  if (options.seed) request.seed = options.seed;
  for (std::uint32_t k = 0; k < options.parameter_count; ++k) {
    if (!options.parameters || !options.parameters[k].name) return Error{"a parameter needs a name"};
    request.parameters.emplace_back(options.parameters[k].name, options.parameters[k].value);
  }
  const std::string raster = options.raster ? options.raster : "";
  for (std::size_t at = 0; at < raster.size();) {
    const std::size_t end = std::min(raster.find(' ', at), raster.size());
    if (end > at)
      if (auto added = raster::addRasterOption(std::string_view(raster).substr(at, end - at), request.raster); !added) return added.error();
    at = end + 1;
  }
  if (options.classes) request.raster.classes = options.classes;
  if (options.program)
    request.build.prober = options.program;
  else if (request.terrain.ends_with(".glsl")) {
    const auto found = process::findProgram("ridgecast-server");
    if (!found) return Error{"a terrain file is tried by ridgecast-server first, which is not in PATH: say where it is"};
    request.build.prober = *found;
  }
  return request;
}

}  // namespace

}  // namespace ridgecast::c

using namespace ridgecast;
using namespace ridgecast::c;

rc_status rc_terrain_open(const char* name, const rc_terrain_options* options, rc_terrain** out) {
  return guarded([&] {
    if (!name || !out) return fail(RC_INVALID, "a terrain needs a name, and a place for its handle");
    if (options && !hasSize(options)) return noSize("rc_terrain_options");
    const auto request = requestOf(name, read(options));
    if (!request) return fail(RC_INVALID, request.error().message);
    auto terrain = user_terrain::load(*request, [](const std::string&) {});
    if (!terrain) return fail(RC_REFUSED, terrain.error().message);
    *out = new rc_terrain{query::Ground(std::move(*terrain))};
    return RC_OK;
  });
}

void rc_terrain_close(rc_terrain* terrain) {
  if (terrain && !terrain->world) delete terrain;
}

uint64_t rc_terrain_hash(const rc_terrain* terrain) {
  std::uint64_t hash = 0;
  guarded([&] {
    if (!terrain) return fail(RC_INVALID, "there is no terrain");
    const auto heard = terrain->ground.hear();
    hash = terrain->ground.hash();
    return heard ? RC_OK : fail(RC_TIMEOUT, heard.error().message);
  });
  return hash;
}

rc_status rc_terrain_heights(rc_terrain* terrain, const double* places, size_t count, float* heights) {
  return guarded([&] {
    if (!terrain || (count > 0 && !(places && heights))) return fail(RC_INVALID, "heights need a terrain, places, and room");
    return heightsOf(*terrain, count, eachOf(places), heights);
  });
}

rc_status rc_terrain_patches(rc_terrain* terrain, const double* bodies, size_t count, const double* offsets, size_t offset_count,
                             float* heights) {
  return guarded([&] {
    if (count == 0 || offset_count == 0) return RC_OK;
    if (!terrain || !bodies || !offsets || !heights) return fail(RC_INVALID, "patches need a terrain, bodies, offsets, and room");
    if (count > PTRDIFF_MAX / sizeof(float) / offset_count) return fail(RC_INVALID, "that is more than there can be");
    const auto placeAt = [body = bodies, offsets, offset_count, next = std::size_t{0}, sin = 0.0, cos = 0.0](std::size_t) mutable {
      if (next == offset_count) body += 3, next = 0;
      if (next == 0) sin = std::sin(body[2]), cos = std::cos(body[2]);
      const double right = offsets[2 * next], back = offsets[2 * next + 1];
      ++next;
      return Place{body[0] + cos * right + sin * back, body[1] - sin * right + cos * back};
    };
    return heightsOf(*terrain, count * offset_count, placeAt, heights);
  });
}

rc_status rc_terrain_normals(rc_terrain* terrain, const double* places, size_t count, double spacing, float* normals) {
  return guarded([&] {
    if (!terrain || (count > 0 && !(places && normals))) return fail(RC_INVALID, "normals need a terrain, places, and room");
    if (!(spacing == 0 || (spacing >= lattice::kMetresPerStep && spacing <= 256)))
      return fail(RC_INVALID, "a normal's spacing is 1/256 to 256 metres, or 0 for 1/16");
    const std::uint32_t steps =
        spacing == 0 ? terrain::kDefaultSpacing : static_cast<std::uint32_t>(std::lround(spacing * lattice::kStepsPerMetre));
    return eachPart(*terrain, count, eachOf(places), [&](auto x, auto z, std::size_t first) {
      const std::span out(normals + 3 * first, 3 * x.size());
      return answer(
          *terrain, [&](auto& ground) { return ground.normals(x, z, out, steps); },
          [&](auto& world) { return world.normals(x, z, out, steps); });
    });
  });
}

rc_status rc_terrain_materials(rc_terrain* terrain, const double* places, size_t count, uint8_t* materials) {
  return guarded([&] {
    if (!terrain || (count > 0 && !(places && materials))) return fail(RC_INVALID, "materials need a terrain, places, and room");
    return eachPart(*terrain, count, eachOf(places), [&](auto x, auto z, std::size_t first) {
      const std::span out(materials + first, x.size());
      return answer(
          *terrain, [&](auto& ground) { return ground.materials(x, z, out); }, [&](auto& world) { return world.materials(x, z, out); });
    });
  });
}

const char* rc_terrain_material(const rc_terrain* terrain, uint8_t material) {
  const std::string_view name = terrain ? terrain::materialName(material, terrain->ownMaterials) : std::string_view();
  return name.empty() ? nullptr : name.data();  // of a literal, or a string
}

const char* rc_terrain_known(const rc_terrain* terrain) {
  return terrain::kKnownNames[terrain ? static_cast<std::size_t>(terrain->known) : 0].data();
}

rc_status rc_terrain_rays(rc_terrain* terrain, const rc_ray* rays, size_t count, rc_hit* hits) {
  return guarded([&] {
    if (!terrain || (count > 0 && (!rays || !hits))) return fail(RC_INVALID, "rays need a terrain, and room for their hits");
    std::vector<ground::Ray> asked(count);
    for (std::size_t k = 0; k < count; ++k) {
      const rc_ray& ray = rays[k];
      const auto x = query::toSteps(ray.origin[0]), z = query::toSteps(ray.origin[2]);
      if (!x || !z) return fail(RC_INVALID, "ray " + std::to_string(k) + " does not begin within 4.398e12 m of the origin");
      asked[k] = {*x, *z, ray.origin[1], ray.direction[0], ray.direction[1], ray.direction[2], ray.reach};
    }
    std::vector<query::Hit> found(count);
    const rc_status status = answer(
        *terrain, [&](auto& ground) { return ground.hits(asked, found); }, [&](auto& world) { return world.hits(asked, found); });
    if (status != RC_OK) return status;
    const auto metres = [](lattice::Step steps) { return static_cast<double>(steps) * lattice::kMetresPerStep; };
    for (std::size_t k = 0; k < count; ++k) {
      const query::Hit& hit = found[k];
      hits[k] = {hit.distance, {metres(hit.at.x), hit.y, metres(hit.at.z)}, {hit.normal[0], hit.normal[1], hit.normal[2]}};
    }
    return RC_OK;
  });
}
