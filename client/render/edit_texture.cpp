#include "client/render/edit_texture.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <array>

#include "common/edits/square.h"
#include "common/outcome/contract.h"

namespace ridgecast::render {
namespace {

constexpr GLint kSide = static_cast<GLint>(edits::kSquareSide);                                      // texels of a square
constexpr std::int64_t kSquares = std::int64_t{1} << (lattice::kCellBits - edits::kSquareStepBits);  // a side of a cell
constexpr GLint kTableSide = static_cast<GLint>(EditTexture::kCells * kSquares);

void useNearest(int levels) {
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, levels > 1 ? GL_NEAREST_MIPMAP_NEAREST : GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, levels - 1);
}

// Of four texels: the mean of their rises and the most frequent of their materials, the first of these if there are several.
std::int32_t together(const std::array<std::int32_t, 4>& four) {
  std::int32_t sum = 0, material = 0;
  std::ptrdiff_t most = 0;
  for (const std::int32_t v : four) {
    sum += v >> 4;
    const auto count = std::ranges::count_if(four, [&](std::int32_t other) { return (other & 15) == (v & 15); });
    if (count > most) material = v & 15;
    most = std::max(most, count);
  }
  return (sum >> 2) * 16 + material;
}

}  // namespace

bool EditTexture::update(const core::HeldEdits& edits, lattice::Point camera, std::size_t most) {
  const lattice::Point cell{lattice::cellOf(camera.x) - kCells / 2, lattice::cellOf(camera.z) - kCells / 2};
  const bool moved = cell.x != cell_.x || cell.z != cell_.z;
  if (seen_ == edits.version() && !(moved && !slots_.empty())) return true;
  cell_ = cell;
  const auto& squares = edits.squares();
  for (auto slot = slots_.begin(); slot != slots_.end();) {
    if (squares.contains(slot->first)) {
      ++slot;
      continue;
    }
    free_.push_back(slot->second.place);
    slot = slots_.erase(slot);
  }
  glActiveTexture(GL_TEXTURE5);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  if (!squares.empty()) grow(squares.size());
  std::size_t uploaded = 0;
  bool all = true;
  for (const auto& [address, version] : squares) {
    const auto slot = slots_.find(address);
    if (slot != slots_.end() && slot->second.version == version) continue;
    if (uploaded++ >= most) {
      all = false;
      break;
    }
    Slot& to = slots_[address];
    if (to.version == 0) {
      expects(!free_.empty(), "the texture has room for each square");
      to.place = free_.back();
      free_.pop_back();
    }
    to.version = version;
    upload(*edits.layer(), address, to.place);
  }
  makeTable();
  glBindTexture(GL_TEXTURE_2D, 0);
  glActiveTexture(GL_TEXTURE0);
  if (all) seen_ = edits.version();
  ++version_;
  return all;
}

// Room for so many squares; a larger texture begins empty. posts_ is bound afterwards.
void EditTexture::grow(std::size_t squares) {
  if (posts_) glBindTexture(GL_TEXTURE_2D, posts_->name());
  if (squares <= static_cast<std::size_t>(columns_) * static_cast<std::size_t>(columns_)) return;
  columns_ = std::max(columns_, 4);
  while (static_cast<std::size_t>(columns_) * static_cast<std::size_t>(columns_) < squares) columns_ *= 2;
  posts_ = makeTexture();
  glBindTexture(GL_TEXTURE_2D, posts_->name());
  for (int level = 0; level < kLevels; ++level)
    glTexImage2D(GL_TEXTURE_2D, level, GL_R32I, columns_ * kSide >> level, columns_ * kSide >> level, 0, GL_RED_INTEGER, GL_INT, nullptr);
  useNearest(kLevels);
  slots_.clear();
  free_.clear();
  for (std::int32_t place = columns_ * columns_; place-- > 0;) free_.push_back(place);
}

void EditTexture::upload(const edits::Layer& layer, edits::SquareAddress address, std::int32_t place) const {
  const edits::Square square = edits::squareOf(layer, address);
  std::vector<std::int32_t> texels(square.rises.size());
  for (std::size_t k = 0; k < texels.size(); ++k) texels[k] = square.rises[k] * 16 + square.materials[k];
  const GLint x = place % columns_ * kSide, y = place / columns_ * kSide;
  for (int level = 0; level < kLevels; ++level) {
    const GLint side = kSide >> level;
    glTexSubImage2D(GL_TEXTURE_2D, level, x >> level, y >> level, side, side, GL_RED_INTEGER, GL_INT, texels.data());
    const auto n = static_cast<std::size_t>(side), half = n / 2;
    for (std::size_t j = 0; j < half; ++j)
      for (std::size_t i = 0; i < half; ++i) {
        const std::size_t k = 2 * j * n + 2 * i;  // never before what is still to be read
        texels[j * half + i] = together({texels[k], texels[k + 1], texels[k + n], texels[k + n + 1]});
      }
  }
}

void EditTexture::makeTable() {
  if (slots_.empty() && !table_) return;
  std::vector<std::int32_t> entries(std::size_t{kTableSide} * kTableSide);
  const auto entry = [&](std::int64_t i, std::int64_t j) -> std::int32_t* {
    i -= cell_.x * kSquares;
    j -= cell_.z * kSquares;
    return i < 0 || j < 0 || i >= kTableSide || j >= kTableSide ? nullptr : &entries[static_cast<std::size_t>(j * kTableSide + i)];
  };
  for (const auto& [a, slot] : slots_)
    for (std::int64_t j = a.j - 1; j <= a.j + 1; ++j)
      for (std::int64_t i = a.i - 1; i <= a.i + 1; ++i)
        if (std::int32_t* const beside = entry(i, j)) *beside = -1;
  for (const auto& [a, slot] : slots_)
    if (std::int32_t* const here = entry(a.i, a.j)) *here = slot.place + 1;
  if (!table_) table_ = makeTexture();
  glBindTexture(GL_TEXTURE_2D, table_->name());
  glTexImage2D(GL_TEXTURE_2D, 0, GL_R32I, kTableSide, kTableSide, 0, GL_RED_INTEGER, GL_INT, entries.data());
  useNearest(1);
}

void EditTexture::bind(const EditTexture* texture, const Program& program) {
  const bool has = texture && texture->table_ && texture->posts_;
  program.set("editsHeld", has ? static_cast<int>(texture->slots_.size()) : 0);
  // Also without edits: samplers of different types must not share a unit.
  program.sample("editsTable", 5, has ? texture->table_->name() : 0);
  program.sample("editsPosts", 6, has ? texture->posts_->name() : 0);
  if (has) program.set("editsCell", static_cast<int>(texture->cell_.x), static_cast<int>(texture->cell_.z));
}

}  // namespace ridgecast::render
