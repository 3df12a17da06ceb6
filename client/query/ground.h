#pragma once
// The true terrain of a session's world, for simulations: heights, normals, materials, rays.
//
// If a terrain here has the world's content hash, a built-in one with its parameters or one that is given, answers are computed locally, at
// once. Otherwise the server is asked, in batches, and each call waits for its answers; also where the session has so many edits that
// making them again would take too long. Both give the same bits. (For the mesh held by the client: mesh_ground.h.)
//
// Places are steps of the lattice (1/256 m); toSteps() converts metres. Local answers: any thread. Answers from the server: not
// thread-safe, but several grounds may share a connection. Copies of a ground share what it has heard of edits.

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/link/connection.h"
#include "common/ground/ground.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::query {

// The nearest step. Error: no number, or beyond the lattice, which ends 4.398e12 m from the origin.
Outcome<lattice::Step> toSteps(double metres);

// Where edits have changed the ground.
struct Change {
  std::uint64_t edit = 0;  // its number
  lattice::Area area;      // bounds what it changed
};
struct News {
  std::uint64_t heard = 0;      // the last edit that has been heard of; less than before: a recording has gone back
  std::uint64_t awaited = 0;    // one that will be (Ground::know), maybe later than `heard`
  std::vector<Change> changes;  // ascending by number
};

// Where a ray meets the ground.
struct Hit {
  double distance = ground::kNoHit;  // metres along the ray; kNoHit: nowhere, and nothing else is set
  lattice::Point at;                 // the nearest step
  double y = 0;                      // metres, of the ray there
  std::array<float, 3> normal{};     // of the ground at that step, as normals() says
};

class Ground {
 public:
  enum class Source { kLocal, kServer };

  // `connection` must outlive this where the source is the server. `timeout`: of one call. `here`: null, or the world's terrain.
  explicit Ground(link::Connection& connection, std::chrono::milliseconds timeout = std::chrono::seconds(10),
                  std::shared_ptr<const terrain::Terrain> here = nullptr);

  // Of a terrain held here.
  explicit Ground(std::shared_ptr<const terrain::Terrain> terrain)
      : timeout_(0), contentHash_(terrain::contentHash(*terrain)), local_(std::move(terrain)) {}

  const std::shared_ptr<const terrain::Terrain>& here() const { return local_; }  // without edits; null: the server is asked
  Source source() const { return local_ ? Source::kLocal : Source::kServer; }

  // From now on, answers include this edit, which the server has acknowledged. (Local ones wait for it.)
  void know(std::uint64_t edit);
  // Takes in edits, whatever the source; any thread. Waits for every edit passed to know(). Error: they did not come in time.
  Outcome<void> hear() const { return hear(timeout_); }
  Outcome<void> hear(std::chrono::milliseconds timeout) const;
  // Where edits after this one have changed the ground, as far as heard.
  News since(std::uint64_t edit) const;
  // The terrain's content hash, changed by each edit heard: equal for an equal terrain with equal edits, undone ones included.
  std::uint64_t hash() const;

  // Heights in metres, as the terrain function returns them. x, z and out have the same size. `edit`: if not null, set to the last edit
  // that all of them include. Errors, here and below: sizes that do not match; the server is gone or did not answer in time: `out` is then
  // undefined.
  Outcome<void> heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out,
                        std::uint64_t* edit = nullptr) const;
  // Unit normals, three numbers each, over `spacing` steps to each side (common/ground/ground.h).
  Outcome<void> normals(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out,
                        std::uint32_t spacing = terrain::kDefaultSpacing) const;
  // What the ground is made of (terrain/materials.h).
  Outcome<void> materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const;
  std::vector<std::string> ownMaterials() const;
  // What cast() and hits() are worth (common/ground).
  terrain::Relief::Known known() const { return local_ ? local_->relief().known : connection_->world().known; }
  // Metres along each ray to the ground; ground::kNoHit if it meets none. A ray out of PROTOCOL.md's ranges is an error that names the
  // field, the same from both sources; the connection lives.
  Outcome<void> cast(std::span<const ground::Ray> rays, std::span<double> out) const;
  // The same, with place and normal.
  Outcome<void> hits(std::span<const ground::Ray> rays, std::span<Hit> out) const;

  // The height of a single place; metres.
  Outcome<double> height(double x, double z) const;

 private:
  // The terrain held here with the edits that have come so far, at least those that it must know().
  struct Known {
    std::shared_ptr<const terrain::Terrain> terrain;
    std::uint64_t edit = 0;
  };
  Outcome<Known> local() const;
  template <class Number, class Make, class Take>
  Outcome<void> ask(std::size_t count, std::size_t each, std::span<Number> out, std::size_t numbers, const Make& make,
                    const Take& take) const;

  link::Connection* const connection_ = nullptr;  // null: of a terrain held here
  const std::chrono::milliseconds timeout_;
  const std::uint64_t contentHash_;
  std::shared_ptr<const terrain::Terrain> local_;  // without edits; null: ask the server
  struct Heard;
  struct Edited;
  std::shared_ptr<Heard> heard_;    // of a session's edits
  std::shared_ptr<Edited> edited_;  // local_ of a session
};

}  // namespace ridgecast::query
