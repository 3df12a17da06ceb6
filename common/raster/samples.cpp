#include "common/raster/samples.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"

namespace ridgecast::raster {
namespace {

// A column's nearest known samples above the row at hand, and below.
struct Column {
  std::int64_t above = -1, below = -1;  // rows; -1: none, or not yet looked for
  std::int32_t heightAbove = 0, heightBelow = 0;
};

// From the first row down. What this pass fills is not known to it.
class Filling {
 public:
  explicit Filling(Samples& samples) : samples_(samples), columns_(samples.width()), row_(samples.width()) {}

  // Whether all could be filled.
  bool pass() {
    bool all = true;
    for (std::uint32_t z = 0; z < samples_.height(); ++z) all = fillRow(z) && all;
    return all;
  }

 private:
  bool fillRow(std::uint32_t z) {
    const auto row = samples_.row(z);
    std::ranges::copy(row, row_.begin());  // as it was
    std::int64_t west = -1, east = -1;
    bool all = true;
    for (std::uint32_t x = 0; x < samples_.width(); ++x) {
      if (row_[x] != kMissing) {
        west = x;
        columns_[x].above = z;
        columns_[x].heightAbove = row_[x];
        continue;
      }
      if (east <= x) east = nextKnown(x);
      lookBelow(x, z);
      row[x] = mean(x, z, west, east);
      all = all && row[x] != kMissing;
    }
    return all;
  }

  // In the row, from x on; the width: none.
  std::int64_t nextKnown(std::int64_t x) const {
    while (x < samples_.width() && row_[static_cast<std::size_t>(x)] == kMissing) ++x;
    return x;
  }

  // Rows are looked at once in each column.
  void lookBelow(std::uint32_t x, std::uint32_t z) {
    Column& column = columns_[x];
    if (column.below > z) return;
    column.below = std::int64_t{z} + 1;
    while (column.below < samples_.height() && samples_.at(x, static_cast<std::uint32_t>(column.below)) == kMissing) ++column.below;
    if (column.below < samples_.height()) column.heightBelow = samples_.at(x, static_cast<std::uint32_t>(column.below));
  }

  std::int32_t mean(std::uint32_t x, std::uint32_t z, std::int64_t west, std::int64_t east) const {
    double sum = 0, weight = 0;
    const auto add = [&](std::int64_t distance, std::int32_t height) {
      sum += height / static_cast<double>(distance);
      weight += 1 / static_cast<double>(distance);
    };
    const Column& column = columns_[x];
    if (west >= 0) add(x - west, row_[static_cast<std::size_t>(west)]);
    if (east < samples_.width()) add(east - x, row_[static_cast<std::size_t>(east)]);
    if (column.above >= 0) add(z - column.above, column.heightAbove);
    if (column.below < samples_.height()) add(column.below - z, column.heightBelow);
    return weight > 0 ? static_cast<std::int32_t>(std::llround(sum / weight)) : kMissing;
  }

  Samples& samples_;
  std::vector<Column> columns_;
  std::vector<std::int32_t> row_;
};

}  // namespace

std::string inMegabytes(std::uint64_t bytes) { return std::to_string((bytes + 999'999) / 1'000'000) + " MB"; }

std::uint64_t Samples::hash() const {
  std::uint64_t hash = 0;
  for (const std::int32_t v : std::span(data_, std::size_t{width_} * height_)) hash = lattice::mix(hash ^ static_cast<std::uint32_t>(v));
  return hash;
}

bool fillMissing(Samples& samples) {
  // After the first pass a row that had a known sample has no missing one; so the second finds one in every column.
  return Filling(samples).pass() || Filling(samples).pass();
}

std::uint64_t dropMixed(Samples& samples) {
  const std::uint32_t width = samples.width(), height = samples.height();
  // Whether a hole is so near in its row, of the rows around one.
  std::array<std::vector<std::uint8_t>, 2 * kMixed + 1> beside;
  const auto look = [&](std::uint32_t z) {
    const auto row = samples.row(z);
    auto& out = beside[z % beside.size()];
    out.assign(width, 0);
    for (std::uint32_t x = 0; x < width; ++x)
      if (row[x] == kMissing)
        for (std::uint32_t k = x < kMixed ? 0 : x - kMixed; k < std::min(x + kMixed + 1, width); ++k) out[k] = 1;
  };
  // Calls f(sample) of each that is there with whether it is beside a hole.
  const auto each = [&](auto&& f) {
    for (std::uint32_t z = 0; z < std::min(kMixed, height); ++z) look(z);
    for (std::uint32_t z = 0; z < height; ++z) {
      if (z + kMixed < height) look(z + kMixed);
      const auto row = samples.row(z);
      for (std::uint32_t x = 0; x < width; ++x) {
        bool isBeside = false;
        for (std::uint32_t k = z < kMixed ? 0 : z - kMixed; k < std::min(z + kMixed + 1, height); ++k)
          isBeside |= beside[k % beside.size()][x] != 0;
        if (row[x] != kMissing) f(row[x], isBeside);
      }
    }
  };
  constexpr std::int32_t kNone = kMissing;
  std::int64_t lowest = std::numeric_limits<std::int64_t>::max(), highest = kNone, lowestBeside = lowest, highestBeside = kNone;
  each([&](std::int32_t v, bool isBeside) {
    auto& least = isBeside ? lowestBeside : lowest;
    auto& most = isBeside ? highestBeside : highest;
    least = std::min<std::int64_t>(least, v);
    most = std::max<std::int64_t>(most, v);
  });
  if (highest == kNone) return 0;  // nothing to judge by
  const std::int64_t margin = std::max<std::int64_t>(2 * (highest - lowest), std::int64_t{2000} * lattice::kStepsPerMetre);
  if (lowestBeside >= lowest - margin && highestBeside <= highest + margin) return 0;
  std::uint64_t dropped = 0;
  each([&](std::int32_t& v, bool isBeside) {
    if (isBeside) v = kMissing, ++dropped;
  });
  return dropped;
}

Outcome<Samples> Samples::create(std::uint32_t width, std::uint32_t height, std::uint64_t inMemory) {
  expects(width > 0 && height > 0, "a map has samples");
  const std::uint64_t bytes = std::uint64_t{width} * height * sizeof(std::int32_t);
  void* data = MAP_FAILED;
  if (bytes <= inMemory) {
    data = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (data == MAP_FAILED) return Error{"it takes " + inMegabytes(bytes) + " of memory, more than is available"};
  } else {
    std::error_code failed;
    const std::filesystem::path folder = std::filesystem::temp_directory_path(failed);
    std::string file = (folder / "ridgecast-XXXXXX").string();
    const int descriptor = failed ? -1 : mkostemp(file.data(), O_CLOEXEC);
    if (descriptor >= 0) unlink(file.c_str());
    // Allocate the space now: a full disk would kill the process later.
    if (descriptor >= 0 && posix_fallocate(descriptor, 0, static_cast<off_t>(bytes)) == 0)
      data = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (descriptor >= 0) ::close(descriptor);
    if (data == MAP_FAILED)
      return Error{"it takes " + inMegabytes(bytes) + " in " + folder.string() +
                   ", where there is not so much room: set TMPDIR to a folder that has it"};
  }
  return Samples(static_cast<std::int32_t*>(data), width, height);
}

Samples::~Samples() {
  if (data_) munmap(data_, bytes());
}

Samples::Samples(Samples&& other) noexcept : data_(std::exchange(other.data_, nullptr)), width_(other.width_), height_(other.height_) {}

}  // namespace ridgecast::raster
