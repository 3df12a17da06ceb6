// The only includer of libtiff: TIFF and BigTIFF in strips or tiles, any packing that libtiff supports, one band of integers or floats, or
// the bands of a picture; and the tags of a GeoTIFF (OGC 19-008r4: pixel scale 33550, tie point 33922, transformation 34264, keys 34735
// with their doubles 34736) and of GDAL (NoData 42113, metadata 42112).

#include <tiffio.h>

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/process/child.h"
#include "common/raster/raster_file.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

constexpr std::uint32_t kPixelScale = 33550, kTiePoint = 33922, kTransformation = 34264, kGeoKeys = 34735, kGeoDoubles = 34736,
                        kNoData = 42113, kMetadata = 42112;
constexpr std::uint16_t kMetre = 9001, kFoot = 9002, kSurveyFoot = 9003, kDegree = 9102, kGreenwich = 8901;  // EPSG's numbers
constexpr std::uint16_t kOwn = 32767;                                                                        // defined by the file
constexpr int kMaxPages = 64;                                                                                // looked at

thread_local std::string complaint;  // libtiff's first error since it was last cleared

void keepComplaint(const char*, const char* format, std::va_list arguments) {
  if (!complaint.empty()) return;
  char text[200];
  std::vsnprintf(text, sizeof text, format, arguments);
  complaint = text;
}

// libtiff only warns about unreadable tags and omits them; the map would then have another place or size.
thread_local std::string warning;
void keepWarning(const char*, const char* format, std::va_list arguments) {
  char text[200];
  std::vsnprintf(text, sizeof text, format, arguments);
  const std::string said = text;
  const bool lost =
      std::strstr(text, "error") || std::strstr(text, "ignored") || std::strstr(text, "ncorrect") || std::strstr(text, "ailed");
  if (warning.empty() && lost) warning = said;
}

// libtiff must know the tags' types; otherwise a hostile file chooses them.
void addTags(TIFF* tiff) {
  static char scale[] = "ModelPixelScale", tie[] = "ModelTiepoint", turn[] = "ModelTransformation", keys[] = "GeoKeyDirectory",
              doubles[] = "GeoDoubleParams", none[] = "GDALNoData", more[] = "GDALMetadata";
  static const TIFFFieldInfo fields[] = {
      {kPixelScale, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, scale},    {kTiePoint, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, tie},
      {kTransformation, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, turn}, {kGeoDoubles, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, doubles},
      {kGeoKeys, -1, -1, TIFF_SHORT, FIELD_CUSTOM, 1, 1, keys},         {kNoData, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, none},
      {kMetadata, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, more},
  };
  TIFFMergeFieldInfo(tiff, fields, std::size(fields));
}

void setUpLibrary() {
  static std::once_flag once;
  std::call_once(once, [] {
    TIFFSetErrorHandler(&keepComplaint);
    TIFFSetWarningHandler(&keepWarning);
    TIFFSetTagExtender(&addTags);
  });
}

class TiffFile final : public RasterFile {
 public:
  // Plain: samples alone.
  TiffFile(std::string name, Content content, bool isPlain) : name_(std::move(name)), content_(content), isPlain_(isPlain) {}
  ~TiffFile() override {
    if (tiff_) TIFFClose(tiff_);
  }
  const RasterHeader& header() const override { return header_; }

  Outcome<void> open(std::uint64_t size, const RasterOptions& options) {
    setUpLibrary();
    complaint.clear();
    warning.clear();
    tiff_ = TIFFOpen(name_.c_str(), "rm");  // not mapped: a file that shrinks must not kill the server
    if (!tiff_) return broken("this is not a TIFF, or a broken one");
    if (!warning.empty())
      return Error{name_ + ": a part of what it says about itself cannot be read (" + warning + "); it is cut off or broken"};
    if (!isPlain_)
      if (auto pages = readPages(); !pages) return pages;
    std::uint16_t bits = 1, format = SAMPLEFORMAT_UINT, packing = COMPRESSION_NONE;
    TIFFGetField(tiff_, TIFFTAG_IMAGEWIDTH, &header_.width);
    TIFFGetField(tiff_, TIFFTAG_IMAGELENGTH, &header_.height);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_SAMPLESPERPIXEL, &header_.bands);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_BITSPERSAMPLE, &bits);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_SAMPLEFORMAT, &format);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_COMPRESSION, &packing);
    kind_ = format == SAMPLEFORMAT_IEEEFP ? Kind::kFloat : format == SAMPLEFORMAT_INT ? Kind::kSigned : Kind::kUnsigned;
    bytes_ = bits / 8u;
    pixelBytes_ = std::size_t{bytes_} * header_.bands;
    if (!header_.unread.empty()) return {};
    if (auto fine = content_ == Content::kColours ? checkPixels(bits, packing) : checkSamples(bits, format); !fine) return fine;
    if (!header_.unread.empty()) return {};
    if (auto fine = checkClaim(name_, header_.width, header_.height, pixelBytes_, size, packing != COMPRESSION_NONE); !fine) return fine;
    if (auto fine = checkPieces(size); !fine) return fine;
    if (!TIFFIsCODECConfigured(packing)) return Error{name_ + ": it is packed in a way that the installed libtiff does not unpack"};
    if (isPlain_) return {};
    readNoData();
    if (header_.unread.empty()) header_.unread = besideIt(name_, isPlaced());
    if (header_.unread.empty() && content_ == Content::kHeights && options.scale == 1) header_.unread = saidByGdal();
    if (!header_.unread.empty()) return {};
    return content_ == Content::kHeights ? readPlace(options) : readLaidPlace();
  }

  Outcome<void> read(std::span<double> out) override {
    complaint.clear();
    const unsigned char* from = nullptr;
    if (tileWidth_) {
      if (next_ % tileHeight_ == 0)
        if (auto read = readTiles(); !read) return read;
      from = &buffer_[next_ % tileHeight_ * rowBytes_];
    } else {
      if (TIFFReadScanline(tiff_, buffer_.data(), next_) != 1) return broken("row " + std::to_string(next_) + " cannot be read");
      from = buffer_.data();
    }
    ++next_;
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = value(from + k * bytes_);
    return {};
  }

 private:
  enum class Kind { kUnsigned, kSigned, kFloat };

  Error broken(const std::string& what) const {
    return {name_ + ": " + what + (complaint.empty() ? "" : " (" + complaint + ")") + "; it is cut off or broken"};
  }

  // Reduced pages behind the map's are of no interest, others are.
  Outcome<void> readPages() {
    std::uint32_t kind = 0;
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_SUBFILETYPE, &kind);
    if (kind & FILETYPE_REDUCEDIMAGE) header_.unread = "a reduced page stands before the map";
    int page = 1;
    for (complaint.clear(); TIFFReadDirectory(tiff_) == 1; ++page) {
      kind = 0;
      TIFFGetFieldDefaulted(tiff_, TIFFTAG_SUBFILETYPE, &kind);
      if (kind & FILETYPE_MASK) header_.unread = "it has a mask";
      if (page == kMaxPages || (!(kind & FILETYPE_REDUCEDIMAGE) && header_.unread.empty()))
        return Error{name_ + ": it has several pages: take one of them (gdal_translate GTIFF_DIR:1:" + name_ + ")"};
    }
    if (!complaint.empty()) return broken("its page " + std::to_string(page + 1) + " cannot be read");
    if (TIFFSetDirectory(tiff_, 0) != 1) return broken("its first page cannot be read again");
    return {};
  }

  bool isPlaced() const { return !tag<double>(kPixelScale).empty() || !tag<double>(kTransformation).empty(); }

  // A scale, an offset or a unit other than metres, in GDAL's metadata.
  std::string saidByGdal() const {
    const char* text = nullptr;
    if (TIFFGetField(tiff_, kMetadata, &text) != 1 || !text) return {};
    const std::string_view said(text);
    for (const std::string_view role : {"role=\"scale\"", "role=\"offset\"", "role=\"unittype\""})
      for (std::size_t at = said.find(role); at != std::string_view::npos; at = said.find(role, at + 1)) {
        const std::string_view value = said.substr(at + role.size(), 8);
        if (role.find("unit") == std::string_view::npos ||
            !(value.starts_with(">m<") || value.starts_with(">metre<") || value.starts_with(">meter<")))
          return "its samples have a scale, an offset or a unit of their own";
      }
    return {};
  }

  Outcome<void> checkSamples(unsigned bits, unsigned format) {
    std::uint16_t extras = 0;
    const std::uint16_t* extra = nullptr;
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_EXTRASAMPLES, &extras, &extra);
    if (header_.bands == 2 && extras == 1 && extra[0] != EXTRASAMPLE_UNSPECIFIED && header_.unread.empty())
      header_.unread = "it has a mask (alpha)";
    if (header_.bands != 1 && header_.unread.empty())
      return Error{name_ + ": it has " + std::to_string(header_.bands) + " bands; " +
                   (content_ == Content::kHeights ? "a height map" : "a map of classes") +
                   " has one (gdal_translate -b 1 takes the first)"};
    const bool isFloat = format == SAMPLEFORMAT_IEEEFP && (bits == 32 || bits == 64);
    const bool isInteger = (format == SAMPLEFORMAT_UINT || format == SAMPLEFORMAT_INT || format == SAMPLEFORMAT_VOID) &&
                           (bits == 8 || bits == 16 || bits == 32);
    if (!isFloat && !isInteger && header_.unread.empty())
      header_.unread = "its samples have " + std::to_string(bits) + " bits of another kind";
    return {};
  }

  Outcome<void> checkPixels(unsigned bits, unsigned packing) {
    std::uint16_t meaning = 0, order = PLANARCONFIG_CONTIG, extras = 0;
    const std::uint16_t* extra = nullptr;
    TIFFGetField(tiff_, TIFFTAG_PHOTOMETRIC, &meaning);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_PLANARCONFIG, &order);
    if (meaning == PHOTOMETRIC_YCBCR && packing == COMPRESSION_JPEG) {
      TIFFSetField(tiff_, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
      meaning = PHOTOMETRIC_RGB;
    }
    if (meaning != PHOTOMETRIC_RGB || (header_.bands != 3 && header_.bands != 4) || kind_ != Kind::kUnsigned || (bits != 8 && bits != 16))
      return Error{
          name_ + ": it has " + std::to_string(header_.bands) + " bands of " + std::to_string(bits) +
          " bits; a picture has red, green, blue and perhaps alpha, each of 8 or 16 bits (gdal_translate -expand rgb makes them of a "
          "palette, -b 1 -b 2 -b 3 takes the first three)"};
    if (order != PLANARCONFIG_CONTIG)
      return Error{name_ + ": its bands are stored one after another, not by pixel: gdal_translate -co INTERLEAVE=PIXEL"};
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_EXTRASAMPLES, &extras, &extra);
    header_.hasAlpha = extras == 1 && extra[0] != EXTRASAMPLE_UNSPECIFIED;
    header_.isPremultiplied = header_.hasAlpha && extra[0] == EXTRASAMPLE_ASSOCALPHA;
    header_.white = bits == 8 ? 255 : 65535;
    return {};
  }

  // Strips and tiles must lie within the file and fit into the memory reserved for them.
  Outcome<void> checkPieces(std::uint64_t size) {
    if (TIFFIsTiled(tiff_)) {
      TIFFGetField(tiff_, TIFFTAG_TILEWIDTH, &tileWidth_);
      TIFFGetField(tiff_, TIFFTAG_TILELENGTH, &tileHeight_);
      const std::uint64_t across = tileWidth_ ? (std::uint64_t{header_.width} + tileWidth_ - 1) / tileWidth_ : 0;
      if (!tileWidth_ || !tileHeight_ || tileWidth_ > 65536 || tileHeight_ > 65536 ||
          across * tileWidth_ * tileHeight_ * pixelBytes_ > kMaxRowBytes)
        return Error{name_ + ": its tiles of " + std::to_string(tileWidth_) + " x " + std::to_string(tileHeight_) +
                     " are too large to read"};
      rowBytes_ = across * tileWidth_ * pixelBytes_;
    } else {
      rowBytes_ = static_cast<std::size_t>(TIFFScanlineSize64(tiff_));
      if (rowBytes_ < std::uint64_t{header_.width} * pixelBytes_ || rowBytes_ > kMaxRowBytes)
        return broken("its rows have an impossible length");
    }
    const std::uint32_t pieces = tileWidth_ ? TIFFNumberOfTiles(tiff_) : TIFFNumberOfStrips(tiff_);
    for (std::uint32_t k = 0; k < pieces; ++k) {
      const std::uint64_t at = TIFFGetStrileOffset(tiff_, k), length = TIFFGetStrileByteCount(tiff_, k);
      if (at == 0 && length == 0)
        return Error{name_ + ": parts of it were never written (a sparse file): write them, with NoData where there is none"};
      if (length > size || at > size - length)
        return broken("part " + std::to_string(k + 1) + " of " + std::to_string(pieces) + " lies beyond the end of the file");
    }
    buffer_.resize(rowBytes_ * (tileWidth_ ? tileHeight_ : 1));
    if (tileWidth_) tile_.resize(static_cast<std::size_t>(TIFFTileSize64(tiff_)));
    if (tileWidth_ && tile_.size() < std::size_t{tileWidth_} * tileHeight_ * pixelBytes_)
      return broken("its tiles have an impossible length");
    return {};
  }

  Outcome<void> readTiles() {
    const std::size_t line = std::size_t{tileWidth_} * pixelBytes_;
    for (std::uint32_t x = 0, k = 0; x < header_.width; x += tileWidth_, ++k) {
      if (TIFFReadTile(tiff_, tile_.data(), x, next_, 0, 0) < 0)
        return broken("the tile at column " + std::to_string(x) + ", row " + std::to_string(next_) + " cannot be read");
      for (std::uint32_t y = 0; y < tileHeight_; ++y) std::memcpy(&buffer_[y * rowBytes_ + k * line], &tile_[y * line], line);
      if (header_.width - x <= tileWidth_) break;
    }
    return {};
  }

  double value(const unsigned char* p) const {
    const auto as = [p](auto v) {
      std::memcpy(&v, p, sizeof v);
      return static_cast<double>(v);
    };
    if (kind_ == Kind::kFloat) return bytes_ == 4 ? as(0.0f) : as(0.0);
    if (kind_ == Kind::kSigned) return bytes_ == 1 ? as(std::int8_t{}) : bytes_ == 2 ? as(std::int16_t{}) : as(std::int32_t{});
    return bytes_ == 1 ? as(std::uint8_t{}) : bytes_ == 2 ? as(std::uint16_t{}) : as(std::uint32_t{});
  }

  void readNoData() {
    const char* text = nullptr;
    if (TIFFGetField(tiff_, kNoData, &text) != 1 || !text) return;
    char* end = nullptr;
    const double v = std::strtod(text, &end);
    if (end != text) header_.noData = kind_ == Kind::kFloat && bytes_ == 4 ? static_cast<double>(static_cast<float>(v)) : v;
  }

  template <class T>
  std::span<const T> tag(std::uint32_t number) const {
    std::uint16_t count = 0;
    const T* values = nullptr;
    if (TIFFGetField(tiff_, number, &count, &values) != 1 || !values) return {};
    return {values, count};
  }

  // The values of the keys that matter here; as OGC 19-008r4 names them.
  struct Keys {
    std::uint16_t modelType = 0, rasterType = 1, projection = 0, geographic = 0, meridian = 0, method = 0, angularUnit = kDegree,
                  linearUnit = 0, heights = 0, heightUnit = 0;  // 0: not said
    double linearUnitSize = 0;                                  // metres, of a unit of the file's own
  };
  Keys readKeys() const {
    Keys out;
    const auto keys = tag<std::uint16_t>(kGeoKeys);
    const auto doubles = tag<double>(kGeoDoubles);
    for (std::size_t k = 4; k + 3 < keys.size(); k += 4) {
      const std::uint16_t where = keys[k + 1], value = keys[k + 3];
      if (where == kGeoDoubles && keys[k] == 3077 && value < doubles.size()) out.linearUnitSize = doubles[value];
      if (where != 0) continue;
      if (keys[k] == 1024) out.modelType = value;
      if (keys[k] == 1025) out.rasterType = value;
      if (keys[k] == 2048) out.geographic = value;
      if (keys[k] == 2051) out.meridian = value;
      if (keys[k] == 2054) out.angularUnit = value;
      if (keys[k] == 3072) out.projection = value;
      if (keys[k] == 3075) out.method = value;
      if (keys[k] == 3076) out.linearUnit = value;
      if (keys[k] == 4096) out.heights = value;
      if (keys[k] == 4099) out.heightUnit = value;
    }
    return out;
  }

  // Metres in the file's unit; empty: unknown.
  static std::optional<double> metresIn(const Keys& keys) {
    switch (keys.linearUnit) {
      case 0:
      case kMetre:
        return 1.0;
      case kFoot:
        return 0.3048;
      case kSurveyFoot:
        return 12 / 39.37;
      case 9036:
        return 1000.0;
      case kOwn:
        if (keys.linearUnitSize > 0) return keys.linearUnitSize;
    }
    return std::nullopt;
  }

  // Metres in the unit of its heights; empty: unknown.
  static std::optional<double> heightUnitOf(const Keys& keys) {
    switch (keys.heightUnit != 0 ? keys.heightUnit : keys.heights) {
      case kFoot:
      case 8228:  // NAVD88
        return 0.3048;
      case kSurveyFoot:
      case 6360:  // NAVD88
      case 5702:  // NGVD29
        return 12 / 39.37;
      case 0:
      case kMetre:
      case 3855:  // EGM2008
      case 5703:  // NAVD88
      case 5773:  // EGM96
        return 1;
      default:
        return std::nullopt;
    }
  }

  // CRS that are not in metres on the ground, or count longitudes from elsewhere, or may.
  static std::string unknownPlace(const Keys& keys) {
    if (keys.modelType == 2) {
      const bool isKnown =
          keys.geographic == 4326 || keys.geographic == 4258 || keys.geographic == 4269 || keys.geographic == 4979 || keys.geographic == 0;
      return isKnown && (keys.meridian == 0 || keys.meridian == kGreenwich) ? "" : "its geographic CRS is not known here";
    }
    constexpr std::uint16_t kMercator = 7;
    if (keys.projection == 3857 || keys.projection == 3785 || keys.projection == 3395 || keys.method == kMercator)
      return "it is in a Mercator projection";
    const auto between = [&](std::uint16_t low, std::uint16_t high) { return keys.projection >= low && keys.projection <= high; };
    const bool isUtm = between(32601, 32660) || between(32701, 32760) || between(25828, 25838) || between(26901, 26923);
    return keys.projection == 0 || keys.linearUnit != 0 || isUtm ? "" : "it does not say in which unit its CRS is";
  }

  // Pixels to the file's unit: x east, y north. (0, 0) is the first pixel's corner, or its middle where pixels are points.
  struct Grid {
    double x = 0, y = 0;          // of (0, 0)
    double across = 0, down = 0;  // from one pixel to the next
    bool isPlaced = false;
  };
  Outcome<std::optional<Grid>> readGrid(const RasterOptions& options) const {
    const auto scale = tag<double>(kPixelScale), tie = tag<double>(kTiePoint), matrix = tag<double>(kTransformation);
    if (scale.size() >= 2) {
      Grid grid{.across = scale[0], .down = scale[1]};
      if (tie.size() >= 6) grid = {tie[3] - tie[0] * scale[0], tie[4] + tie[1] * scale[1], scale[0], scale[1], true};
      return std::optional(grid);
    }
    if (matrix.size() >= 16) {
      if (matrix[1] != 0 || matrix[4] != 0 || !(matrix[0] > 0) || !(matrix[5] < 0))
        return Error{name_ + ": its rows do not run east and its columns south: turn it (gdalwarp)"};
      return std::optional(Grid{matrix[3], matrix[7], matrix[0], -matrix[5], true});
    }
    if (!tie.empty() && !options.pitch)
      return Error{name_ + ": it says where points of it lie, but not how far apart its samples are: warp it (gdalwarp)" +
                   (content_ == Content::kHeights ? ", or say --raster pitch=METRES" : "")};
    return std::optional<Grid>();
  }

  void placeAt(const Grid& grid, const Keys& keys, double unit) {
    const double half = keys.rasterType == 2 ? 0.0 : 0.5;  // to the middle of the pixel; 2: pixels are points
    header_.easting = (grid.x + half * grid.across) * unit;
    header_.northing = (grid.y - half * grid.down) * unit;
  }

  // Whether it lies where the map does is judged by pixels.h.
  Outcome<void> readLaidPlace() {
    const Keys keys = readKeys();
    const auto grid = readGrid({});
    if (!grid) return grid.error();
    const std::optional<double> unit = metresIn(keys);
    if (keys.projection != kOwn) header_.epsg = keys.projection;
    if (!*grid || !(*grid)->isPlaced || !unit || keys.modelType == 2) return {};
    header_.pitch = (*grid)->across * *unit;
    header_.pitchDown = (*grid)->down * *unit;
    placeAt(**grid, keys, *unit);
    return {};
  }

  Outcome<void> readPlace(const RasterOptions& options) {
    const Keys keys = readKeys();
    if (keys.projection != kOwn) header_.epsg = keys.projection;
    if (const auto unit = heightUnitOf(keys))
      header_.heightUnit = *unit;
    else if (options.scale == 1)
      header_.unread = "its heights are in a unit that is not known here";
    if (header_.unread.empty() && !options.pitch) header_.unread = unknownPlace(keys);
    if (header_.unread.empty() && keys.projection == kOwn && process::findProgram("gdalinfo"))
      header_.unread = "its CRS has no EPSG number";
    if (!header_.unread.empty()) return {};
    if (keys.projection == kOwn) header_.read = "its CRS has no EPSG number: without the package gdal-bin it does not lie on Earth";
    const auto grid = readGrid(options);
    if (!grid) return grid.error();
    if (!*grid) return {};
    const std::optional<double> unit = metresIn(keys);
    if (keys.modelType == 2) {  // geographic
      if (keys.angularUnit != kDegree && !options.pitch)
        return Error{name_ + ": its angles are in unit " + std::to_string(keys.angularUnit) +
                     " of the EPSG list, and degrees are read: project it to metres (gdalwarp -t_srs)"};
      const Grid& g = **grid;
      const double half = keys.rasterType == 2 ? 0.0 : 0.5;
      if (g.isPlaced && std::abs(g.x) <= 360 && std::abs(g.y) <= 90.5 && g.across > 0 && g.down > 0)
        header_.degrees = DegreeGrid{g.x + half * g.across, g.y - half * g.down, g.across, g.down};
      if (!header_.degrees && (!options.pitch || options.geographic))
        return Error{name_ +
                     ": its samples are degrees apart, not metres, and it does not say where on Earth: project it, or say --raster "
                     "pitch=METRES"};
      return {};
    }
    if (!unit) {
      if (options.pitch && !options.geographic) return {};
      return Error{name_ + ": its lengths are in unit " + std::to_string(keys.linearUnit) +
                   " of the EPSG list, and metres, feet and kilometres are read: project it to metres (gdalwarp -t_srs), or say --raster "
                   "pitch=METRES without place=geo"};
    }
    const double x = (*grid)->across * *unit, y = (*grid)->down * *unit;
    header_.pitch = x;
    header_.pitchDown = y;
    if (!(*grid)->isPlaced) return {};
    placeAt(**grid, keys, *unit);
    return {};
  }

  std::string name_;
  const Content content_;
  const bool isPlain_;
  TIFF* tiff_ = nullptr;
  RasterHeader header_;
  Kind kind_ = Kind::kUnsigned;
  std::size_t bytes_ = 1, pixelBytes_ = 1, rowBytes_ = 0;
  std::uint32_t tileWidth_ = 0, tileHeight_ = 0, next_ = 0;
  std::vector<unsigned char> buffer_, tile_;
};

}  // namespace

Outcome<std::unique_ptr<RasterFile>> openTiff(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options) {
  auto tiff = std::make_unique<TiffFile>(file.string(), Content::kHeights, false);
  if (auto opened = tiff->open(size, options); !opened) return opened.error();
  return std::unique_ptr<RasterFile>(std::move(tiff));
}

Outcome<std::unique_ptr<RasterFile>> openLaid(const std::filesystem::path& file, Content content, const std::stop_token& stop) {
  std::error_code failed;
  if (!std::filesystem::is_regular_file(file, failed) || failed) return Error{"there is no file " + file.string()};
  if (const std::string ending = text::lower(file.extension().string()); ending != ".tif" && ending != ".tiff")
    return openByGdal(file, "it is no TIFF", {}, content, stop);
  auto tiff = std::make_unique<TiffFile>(file.string(), content, false);
  if (auto opened = tiff->open(std::filesystem::file_size(file, failed), {}); !opened) return opened.error();
  if (const std::string& unread = tiff->header().unread; !unread.empty()) return openByGdal(file, unread, {}, content, stop);
  return std::unique_ptr<RasterFile>(std::move(tiff));
}

Outcome<std::unique_ptr<RasterFile>> openPlain(const std::filesystem::path& file, Content content) {
  std::error_code failed;
  auto tiff = std::make_unique<TiffFile>(file.string(), content, true);
  if (auto opened = tiff->open(std::filesystem::file_size(file, failed), {}); !opened) return opened.error();
  return std::unique_ptr<RasterFile>(std::move(tiff));
}

}  // namespace ridgecast::raster
