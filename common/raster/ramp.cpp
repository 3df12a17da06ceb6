#include "common/raster/ramp.h"

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"
#include "common/text/file.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

constexpr std::size_t kMaxBytes = 1 << 20;

struct Stop {
  double height = 0;
  std::array<double, 4> colour{0, 0, 0, 255};
};

// Nothing but a comment: no stop. Error: not a stop.
Outcome<std::optional<Stop>> stopOf(std::string_view line) {
  line = line.substr(0, line.find('#'));
  std::vector<double> numbers;
  while (!line.empty()) {
    const std::string_view word = line.substr(0, line.find_first_of(" \t,:\r"));
    line.remove_prefix(std::min(line.size(), word.size() + 1));
    if (word.empty()) continue;
    const auto number = text::number<double>(word);
    if (!number) return Error{"'" + std::string(word.substr(0, 40)) + "' is no number"};
    numbers.push_back(*number);
  }
  if (numbers.empty()) return std::optional<Stop>();
  if (numbers.size() != 4 && numbers.size() != 5) return Error{"there are " + std::to_string(numbers.size()) + " numbers"};
  Stop out{numbers[0]};
  if (!(std::abs(out.height) <= 1e6)) return Error{"its height is more than 1,000 km"};
  for (std::size_t k = 1; k < numbers.size(); ++k) {
    if (!(numbers[k] >= 0 && numbers[k] <= 255)) return Error{"a colour is not within 0 to 255"};
    out.colour[k - 1] = numbers[k];
  }
  return std::optional(out);
}

class Ramp final : public RasterFile {
 public:
  Ramp(std::vector<Stop> stops, const Samples& samples, const RasterHeader& map)
      : stops_(std::move(stops)), samples_(samples), header_(map) {
    header_.bands = 4;
    header_.hasAlpha = true;
    header_.noData.reset();
  }
  const RasterHeader& header() const override { return header_; }
  Outcome<void> read(std::span<double> out) override {
    expects(row_ < samples_.height(), "a row lies within its map");
    for (std::uint32_t i = 0; i < samples_.width(); ++i)
      std::ranges::copy(at(lattice::metres(samples_.at(i, row_))), out.begin() + std::ptrdiff_t{4} * i);
    ++row_;
    return {};
  }

 private:
  std::array<double, 4> at(double height) const {
    const auto above = std::ranges::upper_bound(stops_, height, {}, &Stop::height);
    if (above == stops_.begin()) return stops_.front().colour;
    if (above == stops_.end()) return stops_.back().colour;
    const Stop& below = *std::prev(above);
    const double t = (height - below.height) / (above->height - below.height);
    std::array<double, 4> out;
    for (std::size_t c = 0; c < 4; ++c) out[c] = below.colour[c] + t * (above->colour[c] - below.colour[c]);
    return out;
  }

  const std::vector<Stop> stops_;  // by their heights
  const Samples& samples_;
  RasterHeader header_;
  std::uint32_t row_ = 0;
};

}  // namespace

bool isRamp(const std::filesystem::path& file) { return file.extension() == ".txt"; }

Outcome<std::unique_ptr<RasterFile>> openRamp(const std::filesystem::path& file, const Samples& samples, const RasterHeader& map) {
  const std::string name = file.string();
  const auto read = text::readFile(file, kMaxBytes);
  if (!read) return Error{name + ": there is no such file, or it cannot be read"};
  if (read->size() > kMaxBytes) return Error{name + ": it is longer than 1 MiB, too long for a colour ramp"};
  std::vector<Stop> stops;
  std::string_view rest = *read;
  for (int line = 1; !rest.empty(); ++line) {
    const auto stop = stopOf(text::takePart(rest, '\n'));
    if (!stop)
      return Error{name + ": line " + std::to_string(line) + ": " + stop.error().message +
                   "; a line of a colour ramp is HEIGHT RED GREEN BLUE or HEIGHT RED GREEN BLUE ALPHA, in metres and 0 to 255"};
    if (*stop) stops.push_back(**stop);
  }
  if (stops.empty()) return Error{name + ": there is no line HEIGHT RED GREEN BLUE in this colour ramp"};
  std::ranges::stable_sort(stops, {}, &Stop::height);
  return std::unique_ptr<RasterFile>(std::make_unique<Ramp>(std::move(stops), samples, map));
}

}  // namespace ridgecast::raster
