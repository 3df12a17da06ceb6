#pragma once
// The edits that a client holds (core::HeldEdits) as textures: a table of the squares around the camera and the squares' posts with their
// pyramid (common/terrain/edited.glsl). Nothing is made before there are edits. 85 MiB on the graphics card at most, for kMaxHeld squares,
// and 5 MiB for the table. Needs the context it was made in.

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "client/core/ground/held_edits.h"
#include "client/render/gl_objects.h"

namespace ridgecast::render {

class EditTexture {
 public:
  static constexpr std::int64_t kCells = 17;  // a side of the table: 8 cells and more on each side of the camera, 32.8 km
  static constexpr int kLevels = 8;           // the coarsest has one texel a square

  // Uploads at most `most` squares that have changed. Returns whether it now has everything.
  bool update(const core::HeldEdits& edits, lattice::Point camera, std::size_t most = 32);
  std::uint64_t version() const { return version_; }  // grows with every change

  // Sets the uniforms of edited.glsl and binds the textures to units 5 and 6; the program must be in use. Null: no edits.
  static void bind(const EditTexture* texture, const Program& program);

 private:
  struct Slot {
    std::int32_t place = 0;
    std::uint64_t version = 0;  // of the square, as it was uploaded
  };
  void grow(std::size_t squares);
  void upload(const edits::Layer& layer, edits::SquareAddress address, std::int32_t place) const;
  void makeTable();

  std::optional<GlObject> table_, posts_;
  std::int32_t columns_ = 0;  // squares a side of posts_
  std::map<edits::SquareAddress, Slot> slots_;
  std::vector<std::int32_t> free_;
  lattice::Point cell_;  // where the table begins, in cells
  std::uint64_t seen_ = 0, version_ = 0;
};

}  // namespace ridgecast::render
