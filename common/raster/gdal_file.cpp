// Height maps and pictures that GDAL's programs read for us, from Debian's package gdal-bin: what their own readers here do not read
// completely, and all other formats. gdalinfo says what is in the file, gdal_translate writes its samples and what it masks as plain TIFFs.
// The files they read lie in the map's folder: what GDAL lists is judged, and the kernel keeps it from all else (reach.h).

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/process/reach.h"
#include "common/raster/gdal.h"
#include "common/raster/raster_file.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

bool isArchive(const std::filesystem::path& file) {
  constexpr std::array<std::string_view, 9> kEndings = {".zip", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst", ".7z", ".rar"};
  return std::ranges::find(kEndings, file.extension().string()) != kEndings.end();
}

using Json = nlohmann::json;
using std::filesystem::path;

constexpr std::size_t kMaxFilesOfFolder = 4096;
constexpr std::uint64_t kMaxTranslated = std::uint64_t{1} << 30;  // samples

struct Unit {
  std::string_view name;
  double metres;
};
std::optional<double> metresIn(std::string_view name) {
  static constexpr Unit kUnits[] = {{"", 1},          {"m", 1},         {"unspecified", 1},    {"metre", 1},
                                    {"metres", 1},    {"meter", 1},     {"meters", 1},         {"km", 1000},
                                    {"cm", 0.01},     {"dm", 0.1},      {"mm", 0.001},         {"ft", 0.3048},
                                    {"foot", 0.3048}, {"feet", 0.3048}, {"us-ft", 12 / 39.37}, {"US survey foot", 12 / 39.37}};
  for (const Unit& unit : kUnits)
    if (unit.name == name) return unit.metres;
  return std::nullopt;
}

// Rows of the samples, missing where the mask is 0: of a picture transparent.
class GdalFile final : public RasterFile {
 public:
  GdalFile(process::Scratch scratch, RasterHeader header, std::unique_ptr<RasterFile> samples, std::unique_ptr<RasterFile> mask,
           double opaque)
      : scratch_(std::move(scratch)), header_(std::move(header)), samples_(std::move(samples)), mask_(std::move(mask)), opaque_(opaque) {
    known_.resize(mask_ ? header_.width : 0);
    own_.resize(std::size_t{header_.width} * samples_->header().bands);
  }
  const RasterHeader& header() const override { return header_; }
  Outcome<void> read(std::span<double> out) override {
    if (auto read = samples_->row(own_); !read) return read;
    if (mask_)
      if (auto read = mask_->row(known_); !read) return read;
    const std::size_t bands = samples_->header().bands;
    for (std::size_t k = 0; k < header_.width; ++k) {
      std::copy_n(&own_[k * bands], bands, &out[k * header_.bands]);
      if (header_.hasAlpha)
        out[k * header_.bands + bands] = mask_ ? known_[k] * header_.white / opaque_ : header_.white;
      else if (mask_ && known_[k] == 0)
        out[k] = std::nan("");
    }
    return {};
  }

 private:
  process::Scratch scratch_;
  RasterHeader header_;
  std::unique_ptr<RasterFile> samples_, mask_;
  double opaque_;
  std::vector<double> own_, known_;
};

class Reading {
 public:
  Reading(const path& file, const RasterOptions& options, Content content, Gdal tools)
      : file_(file), name_(file.string()), options_(options), content_(content), tools_(std::move(tools)) {}

  Outcome<std::unique_ptr<RasterFile>> open() {
    if (auto made = mosaic(); !made) return made.error();
    const auto printed = tools_.run("gdalinfo", {"-json", source_.string()});
    if (!printed && isArchive(file_)) return error("this is an archive: unpack it, and give the map in it, or the folder of its maps");
    if (!printed) return error("GDAL cannot read it (" + printed.error().message + ")");
    info_ = Json::parse(*printed, nullptr, false);
    if (!info_.is_object() || !info_.contains("bands") || !info_.contains("size"))
      return Error{name_ + ": GDAL's programs describe it in a way that is not understood"};
    if (auto fine = judgeFiles(); !fine) return fine.error();
    if (info_.contains("coordinateSystem") && !info_["coordinateSystem"].value("wkt", "").empty())
      if (const auto proj = tools_.run("gdalsrsinfo", {"--single-line", "-o", "proj4", source_.string()})) proj_ = *proj;
    if (auto fine = judgeBands(); !fine) return fine.error();
    if (auto fine = readPlace(); !fine) return fine.error();
    return translated();
  }

 private:
  Error error(const std::string& what) const { return {name_ + ": " + what}; }

  // A folder of maps side by side.
  Outcome<void> mosaic() {
    source_ = std::filesystem::absolute(file_);  // no name is an option, or a driver's
    std::error_code failed;
    home_ = std::filesystem::weakly_canonical(std::filesystem::is_directory(file_, failed) ? file_ : source_.parent_path(), failed);
    tools_.allow(home_);
    tools_.allow(source_);  // a link leads elsewhere
    if (!std::filesystem::is_directory(file_, failed)) return {};
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(file_, failed))
      if (entry.is_regular_file(failed) && isRasterName(entry.path().string()))
        files.push_back(std::filesystem::absolute(entry.path()).string());
    if (files.empty()) return error("there is no height map in this folder");
    if (files.size() > kMaxFilesOfFolder)
      return error("there are more than 4,096 height maps in this folder: make one of them (gdalbuildvrt)");
    std::ranges::sort(files);
    source_ = tools_.file("mosaic.vrt");
    std::vector<std::string> arguments{"-q", "-strict", source_.string()};
    arguments.insert(arguments.end(), files.begin(), files.end());
    const auto made = tools_.run("gdalbuildvrt", arguments);
    if (!made) return error("GDAL cannot lay its maps side by side (" + made.error().message + ")");
    said_ = std::to_string(files.size()) + " files";
    return {};
  }

  // Nothing is read that the map's folder does not have.
  Outcome<void> judgeFiles() {
    std::error_code failed;
    for (const Json& entry : info_.value("files", Json::array())) {
      const std::string other = entry.get<std::string>();
      if (other == source_.string()) continue;
      const path at = std::filesystem::weakly_canonical(other, failed);
      const auto [end, ignored] = std::mismatch(home_.begin(), home_.end(), at.begin(), at.end());
      const bool isInside = end == home_.end() || (std::next(end) == home_.end() && end->empty());
      if (failed || other.starts_with("/vsi") || !isInside)
        return error("it reads " + other + ", which is not in its folder: put what it needs there");
      sources_.push_back(at);
    }
    return {};
  }

  Outcome<void> judgeBands() {
    header_.width = info_["size"].at(0).get<std::uint32_t>();
    header_.height = info_["size"].at(1).get<std::uint32_t>();
    std::size_t colours = 0;
    for (std::size_t k = 0; k < info_["bands"].size(); ++k)
      if (info_["bands"][k].value("colorInterpretation", "") == "Alpha")
        alpha_ = std::to_string(k + 1);
      else
        ++colours;
    const Json& first = info_["bands"].empty() ? Json() : info_["bands"][0];
    const std::size_t wanted = isPicture_ ? 3 : 1;
    if (colours != wanted)
      return error("it has " + std::to_string(colours) + " bands; " +
                   (isPicture_ ? "a picture has red, green and blue (gdal_translate -expand rgb makes them of a palette)"
                               : std::string(content_ == Content::kHeights ? "a height map" : "a map of classes") +
                                     " has one (gdal_translate -b 1 takes the first)"));
    const std::string type = first.value("type", ""), meaning = first.value("colorInterpretation", "");
    if (type.starts_with("C")) return error("its samples are complex numbers, not heights");
    if (isPicture_ && type != "Byte" && type != "UInt16")
      return error("its bands are of type " + type + "; a picture has 8 or 16 bits each");
    if (content_ == Content::kHeights && meaning == "Palette") return error("its samples are colours of a palette, not heights");
    if (auto fine = checkClaim(name_, header_.width, header_.height, 1, ~std::uint64_t{0}, false); !fine) return fine;
    const double scale = first.value("scale", 1.0), offset = first.value("offset", 0.0);
    isScaled_ = !isPicture_ && (scale != 1 || offset != 0);
    isWide_ = isScaled_ || type == "Float64" || type == "Int32" || type == "UInt32" || type.ends_with("64");
    isMasked_ = !alpha_.empty() || first.contains("noDataValue");
    if (!alpha_.empty() && first.value("noDataValue", Json()).is_number()) header_.noData = first["noDataValue"].get<double>();
    if (first.contains("mask"))
      for (const Json& flag : first["mask"].value("flags", Json::array())) isMasked_ = isMasked_ || flag != "ALL_VALID";
    if (options_.missing) isMasked_ = false;
    header_.bands = isPicture_ ? 4 : 1;
    header_.hasAlpha = isPicture_;
    header_.white = type == "UInt16" ? 65535 : 255;
    if (isPicture_) return {};
    if (content_ == Content::kHeights)
      if (auto fine = readUnit(first.value("unit", "")); !fine) return fine;
    if (isScaled_) say("scale " + text::rounded(scale, 9) + ", offset " + text::rounded(offset, 9));
    if (isMasked_ && (!alpha_.empty() || !first.contains("noDataValue"))) say("mask");
    return {};
  }

  // Of the heights: the band's or, where that says nothing, the vertical part's of the CRS.
  Outcome<void> readUnit(std::string unit) {
    if (unit.empty()) unit = projValue("vunits");
    if (unit.empty()) unit = projValue("vto_meter");
    const auto named = metresIn(unit), metres = named ? named : text::number<double>(unit);
    if (!metres && options_.scale == 1)
      return error("its heights are in \"" + unit + "\": say how many metres that is with --raster scale=");
    header_.heightUnit = metres.value_or(1);
    if (header_.heightUnit != 1) say(unit + " to metres");
    return {};
  }

  // Of the CRS as PROJ has it; empty: not there.
  std::string projValue(std::string_view key) const {
    const std::size_t at = proj_.find("+" + std::string(key) + "=");
    if (at == std::string::npos) return {};
    const std::size_t begin = at + key.size() + 2;
    return proj_.substr(begin, std::min(proj_.find_first_of(" \n", begin), proj_.size()) - begin);
  }

  Outcome<void> readPlace() {
    const Json grid = info_.value("geoTransform", Json());
    if (!grid.is_array()) return {};
    const double west = grid.at(0), across = grid.at(1), north = grid.at(3), down = -grid.at(5).get<double>();
    if (grid.at(2) != 0.0 || grid.at(4) != 0.0 || !(across > 0) || !(down > 0))
      return error("its rows do not run east and its columns south: turn it (gdalwarp)");
    if (const Json epsg = info_.value("stac", Json::object()).value("proj:epsg", Json()); epsg.is_number_unsigned() && epsg < 65536)
      header_.epsg = epsg.get<std::uint16_t>();
    else
      header_.crs = proj_.substr(0, proj_.find_last_not_of(" \n") + 1);
    if (projValue("proj") == "longlat") {
      if (!projValue("pm").empty()) return error("its longitudes do not count from Greenwich: gdalwarp -t_srs EPSG:4326 makes them");
      if (std::abs(west) <= 360 && std::abs(north) <= 90.5) header_.degrees = DegreeGrid{west + across / 2, north - down / 2, across, down};
      return {};
    }
    if (projValue("proj") == "merc" && !options_.pitch) {
      return error("it is in a Mercator projection, whose metres are not those on the ground: project it (gdalwarp -t_srs " + zone() + ")");
    }
    const std::string toMetre = projValue("to_meter"), units = projValue("units");
    const auto unit = toMetre.empty() ? metresIn(units) : text::number<double>(toMetre);
    if (!unit) return error("its lengths are in \"" + units + "\": project it to metres (gdalwarp -t_srs), or say --raster pitch=METRES");
    if (*unit != 1) say("lengths in " + (units.empty() ? toMetre + " m" : units));
    header_.pitch = across * *unit;
    header_.pitchDown = down * *unit;
    header_.easting = (west + across / 2) * *unit;
    header_.northing = (north - down / 2) * *unit;
    return {};
  }

  std::string zone() const {
    const Json corners = info_.value("wgs84Extent", Json::object()).value("coordinates", Json::array());
    if (corners.empty() || corners[0].empty()) return "to metres";
    const double longitude = corners[0][0].at(0), latitude = corners[0][0].at(1);
    return "EPSG:" + std::to_string(utmZone(longitude, latitude));
  }

  Outcome<std::unique_ptr<RasterFile>> translated() {
    const path samples = tools_.file("samples.tif"), mask = tools_.file("mask.tif");
    const std::uint64_t bytes = std::uint64_t{header_.width} * header_.height *
                                (isPicture_ ? 3 * (header_.white > 255 ? 2 : 1)
                                 : isWide_  ? 8
                                            : 4);
    std::error_code failed;
    const auto room = std::filesystem::space(tools_.file(""), failed);
    if (std::uint64_t{header_.width} * header_.height > kMaxTranslated || (!failed && room.available < 2 * bytes))
      return error(
          "GDAL's programs would write " + std::to_string(2 * bytes / 1'000'000) +
          " MB, for more than 2^30 samples or more than there is room for: make a plain GeoTIFF of it (gdal_translate), or set TMPDIR "
          "to a folder that has the room");
    std::vector<std::string> arguments{
        "-q",    "-of",  "GTiff", "-co", "PROFILE=BASELINE", "-co", "BIGTIFF=IF_SAFER", "-co", "INTERLEAVE=PIXEL", "-a_nodata", "none",
        "-mask", "none", "-b",    "1"};
    if (isPicture_)
      arguments.insert(arguments.end(), {"-b", "2", "-b", "3", "-co", "PHOTOMETRIC=RGB", "-colorinterp", "red,green,blue"});
    else
      arguments.insert(arguments.end(), {"-ot", isWide_ ? "Float64" : "Float32"});
    if (isScaled_ && options_.scale == 1 && options_.offset == 0) arguments.push_back("-unscale");
    arguments.insert(arguments.end(), {source_.string(), samples.string()});
    if (auto made = tools_.run("gdal_translate", arguments, bytes); !made)
      return error("GDAL cannot read it (" + made.error().message + ")");
    if (isMasked_)
      if (auto made = tools_.run("gdal_translate",
                                 {"-q", "-of", "GTiff", "-co", "PROFILE=BASELINE", "-co", "BIGTIFF=IF_SAFER", "-b",
                                  alpha_.empty() ? "mask" : alpha_, "-a_nodata", "none", source_.string(), mask.string()},
                                 bytes);
          !made)
        return error("GDAL cannot read its mask (" + made.error().message + ")");
    auto own = openPlain(samples, content_);
    if (!own) return error("GDAL's programs wrote what cannot be read (" + own.error().message + ")");
    const auto isOfSize = [&](const RasterHeader& made) { return made.width == header_.width && made.height == header_.height; };
    if (!isOfSize((*own)->header())) return error("GDAL's programs wrote a map of another size than they said");
    std::unique_ptr<RasterFile> known;
    if (isMasked_) {
      auto opened = openPlain(mask, Content::kHeights);
      if (!opened) return error("GDAL's programs wrote a mask that cannot be read (" + opened.error().message + ")");
      if (!isOfSize((*opened)->header())) return error("GDAL's programs wrote a mask of another size than the map's");
      known = std::move(*opened);
    }
    const double opaque = alpha_.empty() ? 255 : header_.white;
    if (!process::ReachRules::areKept()) say("unconfined, for this kernel has no Landlock");
    header_.sources = sources_;
    header_.read = "read by GDAL as " + info_.value("driverShortName", std::string("?")) + (said_.empty() ? "" : ": " + said_);
    return std::unique_ptr<RasterFile>(
        std::make_unique<GdalFile>(std::move(*tools_.takeScratch()), std::move(header_), std::move(*own), std::move(known), opaque));
  }

  void say(const std::string& what) { said_.append(said_.empty() ? "" : ", ").append(what); }

  const path file_;
  const std::string name_;
  const RasterOptions& options_;
  const Content content_;
  const bool isPicture_ = content_ == Content::kColours;
  Gdal tools_;
  path source_;  // the file, or a mosaic of a folder
  path home_;    // the folder that all of it lies in
  std::vector<path> sources_;
  Json info_;
  std::string proj_;
  RasterHeader header_;
  std::string said_;
  std::string alpha_;  // the band's number; empty: there is none
  bool isScaled_ = false, isWide_ = false, isMasked_ = false;
};

}  // namespace

Outcome<std::unique_ptr<RasterFile>> openByGdal(const std::filesystem::path& file, const std::string& why, const RasterOptions& options,
                                                Content content, const std::stop_token& stop) {
  auto tools = Gdal::find(file.string() + ": " + why + ", which GDAL's programs read", stop);
  if (!tools) return tools.error();
  try {
    return Reading(file, options, content, std::move(*tools)).open();
  } catch (const Json::exception&) {
    return Error{file.string() + ": GDAL's programs describe it in a way that is not understood"};
  }
}

}  // namespace ridgecast::raster
