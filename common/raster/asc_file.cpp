// ESRI's ASCII grid.

#include <array>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "common/raster/raster_file.h"
#include "common/terrain/raster.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

constexpr std::size_t kMaxWord = 64;  // characters

class AscFile final : public RasterFile {
 public:
  explicit AscFile(const std::filesystem::path& file) : name_(file.string()), in_(file, std::ios::binary), buffer_(std::size_t{1} << 16) {}
  const RasterHeader& header() const override { return header_; }

  Outcome<void> open(std::uint64_t size, bool hasPitch) {
    if (!in_) return Error{"cannot read " + name_};
    std::array<std::optional<double>, kKeys.size()> values;
    std::string word = next();
    for (; !word.empty() && std::isalpha(static_cast<unsigned char>(word[0])) && !isNan(word); word = next()) {
      word = text::lower(word);
      std::size_t key = 0;
      while (key < kKeys.size() && kKeys[key] != word) ++key;
      const std::string text = next();
      const auto value = key == kNone ? sampleOf(text) : text::number<double>(text);
      if (word == "dx" || word == "dy") {
        header_.unread = "it is an ASCII grid with dx and dy";
        return {};
      }
      if (key == kKeys.size() || values[key] || !value)
        return Error{
            name_ + ": '" + shown(word) + " " + shown(text) +
            "' does not belong to an ASCII grid, which says ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize and "
            "nodata_value, each a number and once"};
      values[key] = value;
    }
    first_ = std::move(word);
    return understand(values, size, hasPitch);
  }

  Outcome<void> read(std::span<double> out) override {
    for (std::uint32_t x = 0; x < header_.width; ++x) {
      const std::string word = first_.empty() ? next() : std::exchange(first_, {});
      if (word.empty()) return Error{name_ + ": it ends in row " + std::to_string(row_) + "; it is cut off"};
      const auto value = sampleOf(word);
      if (!value || word.size() > kMaxWord)
        return Error{name_ + ": '" + shown(word) + "' at column " + std::to_string(x) + ", row " + std::to_string(row_) +
                     " is not a number"};
      out[x] = *value;
    }
    if (++row_ == header_.height && !next().empty()) return Error{name_ + ": it has more samples than ncols x nrows; correct the header"};
    return {};
  }

 private:
  enum Key { kColumns, kRows, kCornerX, kCentreX, kCornerY, kCentreY, kCell, kNone };
  static constexpr std::array<std::string_view, 8> kKeys{"ncols",     "nrows",     "xllcorner", "xllcenter",
                                                         "yllcorner", "yllcenter", "cellsize",  "nodata_value"};

  static bool isNan(const std::string& word) { return text::lower(word) == "nan"; }
  static std::optional<double> sampleOf(const std::string& word) {
    return isNan(word) ? std::numeric_limits<double>::quiet_NaN() : text::number<double>(word);
  }
  static std::string shown(const std::string& word) {
    std::string out;
    for (const char c : word.substr(0, 32)) out += c > ' ' && c <= '~' && c != '\'' ? c : '?';
    return out;
  }

  Outcome<void> understand(const std::array<std::optional<double>, kKeys.size()>& values, std::uint64_t size, bool hasPitch) {
    const auto count = [&](Key key) {
      const double v = values[key].value_or(0);
      return v >= 1 && v <= 1e10 && v == std::floor(v) ? static_cast<std::uint64_t>(v) : 0;
    };
    const std::uint64_t columns = count(kColumns), rows = count(kRows);
    if (columns == 0 || rows == 0 || !(values[kCell].value_or(0) > 0))
      return Error{name_ + ": this is not an ASCII grid, or a broken one: it begins with ncols, nrows and cellsize, each above 0"};
    if (auto fine = checkClaim(name_, columns, rows, 2, size + 1, false); !fine) return fine.error();  // a digit and a blank each
    header_.width = static_cast<std::uint32_t>(columns);
    header_.height = static_cast<std::uint32_t>(rows);
    header_.noData = values[kNone];
    const double cell = *values[kCell];
    const auto middle = [&](Key corner, Key centre) -> std::optional<double> {
      if (values[centre]) return values[centre];
      if (values[corner]) return *values[corner] + cell / 2;
      return std::nullopt;
    };
    const auto west = middle(kCornerX, kCentreX), south = middle(kCornerY, kCentreY);
    const auto north = south ? std::optional(*south + static_cast<double>(rows - 1) * cell) : std::nullopt;
    header_.unread = besideIt(name_, false);
    if (!header_.unread.empty()) return {};
    const bool isSmall = cell < terrain::kMinPitch / terrain::kPartsPerMetre;
    if (isSmall && west && north && std::abs(*west) <= 180 && std::abs(*south) <= 90 && std::abs(*north) <= 90) {
      header_.degrees = DegreeGrid{*west, *north, cell, cell};
      return {};
    }
    const bool mayBeDegrees = cell <= 1 && west && north && std::abs(*west) <= 360 && std::abs(*south) <= 90 && std::abs(*north) <= 90;
    if (mayBeDegrees && !hasPitch && (std::abs(*west) > cell || std::abs(*south) > cell))
      return Error{name_ + ": it does not say whether its cells of " + text::rounded(cell, 6) +
                   " are degrees or metres: say --raster pitch=" + text::rounded(cell, 6) + " for metres, or project it (gdalwarp)"};
    header_.pitch = header_.pitchDown = cell;
    if (west && north) {
      header_.easting = west;
      header_.northing = north;
    }
    return {};
  }

  // Empty: the end.
  std::string next() {
    std::string out;
    while (true) {
      if (at_ == held_) {
        in_.read(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
        held_ = static_cast<std::size_t>(in_.gcount());
        at_ = 0;
        if (held_ == 0) return out;
      }
      const char c = buffer_[at_++];
      const bool isBlank = c == ' ' || (c >= '\t' && c <= '\r');
      if (isBlank && !out.empty()) return out;
      if (!isBlank) out += c;
      if (out.size() > kMaxWord) return out;
    }
  }

  std::string name_;
  std::ifstream in_;
  std::vector<char> buffer_;
  std::size_t at_ = 0, held_ = 0;
  RasterHeader header_;
  std::string first_;  // of the samples, read with the header
  std::uint32_t row_ = 0;
};

}  // namespace

Outcome<std::unique_ptr<RasterFile>> openAsc(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options) {
  auto asc = std::make_unique<AscFile>(file);
  if (auto opened = asc->open(size, options.pitch.has_value()); !opened) return opened.error();
  return std::unique_ptr<RasterFile>(std::move(asc));
}

}  // namespace ridgecast::raster
