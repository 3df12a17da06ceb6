// RAW16: rows of 16-bit numbers and nothing else, as terrain tools exchange them. Also the code that all formats share.

#include <cmath>
#include <fstream>
#include <string_view>
#include <vector>

#include "common/raster/raster_file.h"
#include "common/terrain/raster.h"
#include "common/text/file.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

class RawFile final : public RasterFile {
 public:
  RawFile(std::string name, std::ifstream in, const RasterHeader& header, bool bigEndian, bool isSigned)
      : name_(std::move(name)),
        in_(std::move(in)),
        header_(header),
        bigEndian_(bigEndian),
        isSigned_(isSigned),
        bytes_(2 * std::size_t{header.width}) {}
  const RasterHeader& header() const override { return header_; }
  Outcome<void> read(std::span<double> out) override {
    in_.read(reinterpret_cast<char*>(bytes_.data()), static_cast<std::streamsize>(bytes_.size()));
    if (!in_) return Error{name_ + ": the file is cut off"};
    for (std::size_t k = 0; k < out.size(); ++k) {
      const auto v = static_cast<std::uint16_t>(bytes_[2 * k + (bigEndian_ ? 1 : 0)] | bytes_[2 * k + (bigEndian_ ? 0 : 1)] << 8);
      out[k] = isSigned_ ? static_cast<double>(static_cast<std::int16_t>(v)) : static_cast<double>(v);
    }
    return {};
  }

 private:
  std::string name_;
  std::ifstream in_;
  RasterHeader header_;
  bool bigEndian_, isSigned_;
  std::vector<unsigned char> bytes_;
};

}  // namespace

Outcome<void> checkClaim(const std::string& file, std::uint64_t width, std::uint64_t height, std::uint64_t sampleBytes, std::uint64_t size,
                         bool packed) {
  const std::string claim = std::to_string(width) + " x " + std::to_string(height) + " samples";
  if (width < 2 || height < 2) return Error{file + ": it has " + claim + "; there are at least 2 x 2"};
  if (width > 0xffffffffu || height > 0xffffffffu || width > kMaxSamples / height)
    return Error{file + ": it claims " + claim + "; there are at most 2^32"};
  const std::uint64_t bytes = width * height * sampleBytes;
  const bool isTooWell = (bytes > kBelieved && bytes / kMaxUnpacked > size) || width * sampleBytes / kMaxUnpacked > size;
  if (packed ? isTooWell : bytes > size)
    return Error{file + ": it claims " + claim + ", " + std::to_string(bytes) + " bytes, but the file has only " + std::to_string(size) +
                 "; it is cut off or broken"};
  if (width * sampleBytes > kMaxRowBytes) return Error{file + ": a row of " + std::to_string(width) + " samples is too long to read"};
  return {};
}

Outcome<std::unique_ptr<RasterFile>> openRaw(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options) {
  RasterHeader header;
  header.width = options.width;
  header.height = options.height;
  if (!header.width) {
    const auto side = static_cast<std::uint64_t>(std::llround(std::sqrt(static_cast<double>(size) / 2)));
    if (size % 2 != 0 || side * side * 2 != size || side > 65536)
      return Error{file.string() + ": " + std::to_string(size) + " bytes are no square of 16-bit samples: say --raster size=COLUMNSxROWS"};
    header.width = header.height = static_cast<std::uint32_t>(side);
  }
  if (auto fine = checkClaim(file.string(), header.width, header.height, 2, size, false); !fine) return fine.error();
  if (std::uint64_t{header.width} * header.height * 2 != size)
    return Error{file.string() + ": it has " + std::to_string(size) + " bytes, " + std::to_string(header.width) + " x " +
                 std::to_string(header.height) + " 16-bit samples take " + std::to_string(std::uint64_t{header.width} * header.height * 2) +
                 ": correct --raster size=COLUMNSxROWS"};
  std::ifstream in(file, std::ios::binary);
  if (!in) return Error{"cannot read " + file.string()};
  return std::unique_ptr<RasterFile>(std::make_unique<RawFile>(file.string(), std::move(in), header, options.bigEndian, options.isSigned));
}

Outcome<std::unique_ptr<RasterFile>> openHgt(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options) {
  const auto side = static_cast<std::uint64_t>(std::llround(std::sqrt(static_cast<double>(size) / 2)));
  if (size % 2 != 0 || side * side * 2 != size || side > 65536)
    return Error{file.string() + ": " + std::to_string(size) + " bytes are no square of 16-bit samples; it is cut off or broken"};
  if (auto fine = checkClaim(file.string(), side, side, 2, size, false); !fine) return fine.error();
  RasterHeader header;
  header.width = header.height = static_cast<std::uint32_t>(side);
  header.noData = -32'768;
  const std::string name = file.stem().string();
  const auto sign = [&](std::size_t at, char plus, char minus) { return name[at] == plus ? 1 : name[at] == minus ? -1 : 0; };
  if (name.size() >= 7) {
    const auto south = text::number<int>(std::string_view(name).substr(1, 2)),
               west = text::number<int>(std::string_view(name).substr(4, 3));
    const int north = sign(0, 'N', 'S'), east = sign(3, 'E', 'W');
    const double step = 1.0 / static_cast<double>(side - 1);
    if (south && west && north && east && *south <= 90 && *west <= 180)
      header.degrees = DegreeGrid{static_cast<double>(east * *west), static_cast<double>(north * *south + 1), step, step};
  }
  if (!header.degrees && !options.pitch)
    return Error{file.string() +
                 ": an .hgt file is named after its south-west corner, such as N47E011.hgt: rename it, or say --raster pitch=METRES"};
  std::ifstream in(file, std::ios::binary);
  if (!in) return Error{"cannot read " + file.string()};
  return std::unique_ptr<RasterFile>(std::make_unique<RawFile>(file.string(), std::move(in), header, true, true));
}

Outcome<std::unique_ptr<RasterFile>> openRaster(const std::filesystem::path& file, const RasterOptions& options,
                                                const std::stop_token& stop) {
  std::error_code failed;
  if (std::filesystem::is_directory(file, failed)) return openByGdal(file, "it is a folder of maps", options, Content::kHeights, stop);
  if (!std::filesystem::is_regular_file(file, failed) || failed) return Error{"there is no file " + file.string()};
  const std::uint64_t size = std::filesystem::file_size(file, failed);
  if (failed || !std::ifstream(file)) return Error{"cannot read " + file.string()};
  const std::string ending = text::lower(file.extension().string());
  Outcome<std::unique_ptr<RasterFile>> own =
      ending == ".tif" || ending == ".tiff" ? openTiff(file, size, options)
      : ending == ".asc"                    ? openAsc(file, size, options)
      : ending == ".hgt"                    ? openHgt(file, size, options)
      : ending == ".png"                    ? openPng(file, size)
      : ending == ".r16" || ending == ".raw"
          ? openRaw(file, size, options)
          : openByGdal(file, "it is no TIFF, PNG, ASCII grid or raw file", options, Content::kHeights, stop);
  if (!own || (*own)->header().unread.empty()) return own;
  return openByGdal(file, (*own)->header().unread, options, Content::kHeights, stop);
}

std::string besideIt(const std::filesystem::path& file, bool isPlaced) {
  const auto exists = [](const std::filesystem::path& path) {
    std::error_code failed;
    return std::filesystem::is_regular_file(path, failed);
  };
  const std::string name = file.string(), bare = name.substr(0, name.size() - file.extension().string().size());
  if (exists(name + ".msk")) return "a mask lies beside it (.msk)";
  // Statistics, which programs leave there, change nothing.
  if (const auto said = text::readFile(name + ".aux.xml", std::size_t{1} << 20))
    for (const char* word : {"<GeoTransform", "<SRS", "<GCPList", "<NoDataValue", "<Offset", "<Scale", "<UnitType", "<MaskBand"})
      if (said->size() > std::size_t{1} << 20 || said->find(word) != std::string::npos)
        return "a file beside it says more of it (.aux.xml)";
  if (isPlaced) return {};
  for (const char* world : {".tfw", ".TFW", ".tifw", ".pgw", ".PGW", ".pngw", ".wld", ".WLD", ".prj", ".PRJ"})
    if (exists(bare + world)) return std::string("a file beside it says where it lies (") + world + ")";
  return {};
}

}  // namespace ridgecast::raster
