#pragma once
// The boundary between C and C++: exceptions become statuses and messages here. Structs with `size` may be shorter or longer than ours.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/c/ridgecast.h"
#include "client/query/ground.h"
#include "client/world/world.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

struct rc_terrain {
  ridgecast::query::Ground ground;
  rc_world* world = nullptr;  // that it belongs to
  const std::vector<std::string> ownMaterials = ground.ownMaterials();
  const ridgecast::terrain::Relief::Known known = ground.known();
  bool isAsked() const { return ground.source() == ridgecast::query::Ground::Source::kServer; }
};

struct rc_world {
  std::unique_ptr<ridgecast::world::World> world;
  rc_terrain terrain;
  std::mutex mutex{};  // a call at a time
};

namespace ridgecast::c {

// Stores the message for rc_message().
rc_status fail(rc_status status, std::string message);
rc_status fail(const world::Failure& failure);

// Runs `body`, which returns a status.
template <class Body>
rc_status guarded(const Body& body) noexcept {
  try {
    return body();
  } catch (const std::length_error&) {
    return fail(RC_INVALID, "that is more than there can be");
  } catch (const std::bad_alloc&) {
    return fail(RC_MEMORY, "out of memory");  // short: takes none
  } catch (const std::exception& e) {
    return fail(RC_INTERNAL, e.what());
  }
}

template <class Struct>
bool hasSize(const Struct* given) {
  return given->size >= sizeof(given->size) && given->size <= 1 << 16 && given->size % alignof(Struct) == 0;
}
rc_status noSize(const char* name);

// What an older or newer program says.
template <class Struct>
Struct read(const Struct* given) {
  Struct out{};
  if (given) std::memcpy(&out, given, std::min(given->size, sizeof(Struct)));
  return out;
}

template <class Struct>
void write(Struct value, Struct* out) {
  value.size = out->size;
  std::memcpy(out, &value, std::min(out->size, sizeof(Struct)));
}

// The k-th of an array whose entries have the size that the first one says.
template <class Struct>
Struct* entry(Struct* first, std::size_t k) {
  return reinterpret_cast<Struct*>(reinterpret_cast<char*>(first) + k * first->size);
}

// Writes up to `room` of them, and says how many there are.
template <class Struct>
rc_status writeAll(const std::vector<Struct>& all, Struct* out, std::size_t room, std::size_t* count, const char* name) {
  if (!count || (room > 0 && !out)) return fail(RC_INVALID, "a list needs room, and a place for its count");
  if (room > 0 && !hasSize(out)) return noSize(name);
  for (std::size_t k = 1; k < std::min(room, all.size()); ++k) entry(out, k)->size = out->size;
  for (std::size_t k = 0; k < std::min(room, all.size()); ++k) write(all[k], entry(out, k));
  *count = all.size();
  return RC_OK;
}

Outcome<std::chrono::milliseconds> milliseconds(double seconds);

// A mesh for C, which owns its arrays.
const rc_mesh* made(world::Mesh&& mesh);

}  // namespace ridgecast::c
