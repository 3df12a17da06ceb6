#include "server/snapshot/geotiff.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/outcome/contract.h"
#include "common/raster/gdal.h"
#include "common/terrain/raster.h"
#include "common/text/file.h"
#include "common/text/text.h"

namespace ridgecast::snapshot {
namespace {

constexpr std::uint32_t kPartRows = 256;

std::string inXml(std::string_view text) {
  std::string out;
  for (const char c : text) c == '&' ? out += "&amp;" : c == '<' ? out += "&lt;" : out += c;
  return out;
}

// For GDAL: what lies in heights.f32, and where.
std::string virtualFile(const map::Sheet& sheet, const terrain::Raster* map, const std::string& description) {
  const auto exact = [](double v) { return text::rounded(v, 17); };
  const double pitchX = sheet.pitchX * lattice::kMetresPerStep, pitchZ = sheet.pitchZ * lattice::kMetresPerStep;
  terrain::GridPlace origin;
  std::string crs;
  if (const auto there = map ? terrain::onGrid(*map, {}) : std::nullopt) {
    origin = *there;
    crs = map->origin().crs;
  }
  const double west = origin.easting + sheet.x * lattice::kMetresPerStep - pitchX / 2,
               north = origin.northing - sheet.z * lattice::kMetresPerStep + pitchZ / 2;
  std::string out =
      "<VRTDataset rasterXSize=\"" + std::to_string(sheet.columns) + "\" rasterYSize=\"" + std::to_string(sheet.rows) + "\">\n";
  if (!crs.empty()) out += "<SRS>" + inXml(crs) + "</SRS>\n";
  out += "<GeoTransform>" + exact(west) + ", " + exact(pitchX) + ", 0, " + exact(north) + ", 0, " + exact(-pitchZ) + "</GeoTransform>\n";
  out += "<Metadata><MDI key=\"TIFFTAG_IMAGEDESCRIPTION\">" + inXml(description) + "</MDI>" +
         (crs.empty() ? "" : "<MDI key=\"AREA_OR_POINT\">Point</MDI>") + "</Metadata>\n";
  out += "<VRTRasterBand dataType=\"Float32\" band=\"1\" subClass=\"VRTRawRasterBand\"><UnitType>m</UnitType>";
  out += "<SourceFilename relativeToVRT=\"1\">heights.f32</SourceFilename><ImageOffset>0</ImageOffset><PixelOffset>4</PixelOffset>";
  out += "<LineOffset>" + std::to_string(4 * sheet.columns) + "</LineOffset><ByteOrder>LSB</ByteOrder></VRTRasterBand>\n</VRTDataset>\n";
  return out;
}

Problem noRoom() { return {Problem::Kind::kFailed, "There is no room for the file's samples: set TMPDIR to a folder that has it."}; }

// A row. Where the samples are the map's own and a place between steps, heights at the nearest step would not be theirs.
std::vector<float> rowOf(const terrain::Terrain& terrain, const OfGrid& grid, std::uint32_t row, const std::stop_token& stop) {
  map::Sheet sheet = grid.sheet;
  sheet.z += row * sheet.pitchZ;
  sheet.rows = 1;
  if (!grid.first) return map::heights(terrain, sheet, stop);
  std::vector<float> out(sheet.columns);
  std::array<std::int32_t, terrain::kTileSide> samples{};
  for (std::uint32_t from = 0; from < sheet.columns; from += samples.size()) {
    const auto count = std::min<std::uint32_t>(samples.size(), sheet.columns - from);
    terrain.raster()->samples((*grid.first)[0] + from, (*grid.first)[1] + row, static_cast<std::int32_t>(count), 1, samples.data());
    for (std::uint32_t k = 0; k < count; ++k) out[from + k] = static_cast<float>(lattice::metres(samples[k]));
  }
  const auto* const edited = dynamic_cast<const edits::EditedTerrain*>(&terrain);
  if (!edited) return out;
  const auto now = map::heights(terrain, sheet, stop), before = map::heights(*edited->base(), sheet, stop);
  for (std::size_t k = 0; k < std::min(now.size(), before.size()); ++k) out[k] += now[k] - before[k];
  return out;
}

// Row after row, a part at a time. False: it could not be written.
bool writeSamples(const terrain::Terrain& terrain, const OfGrid& grid, const std::filesystem::path& file, scheduling::Pool& pool,
                  const box::Watch& watch, Progress* progress) {
  std::ofstream out(file, std::ios::binary);
  const std::uint32_t all = grid.sheet.rows;
  if (progress) progress->parts = (all + kPartRows - 1) / kPartRows;
  for (std::uint32_t first = 0; first < all && out && !watch.over(); first += kPartRows) {
    std::vector<std::vector<float>> rows(std::min(kPartRows, all - first));
    pool.forEach(rows.size(), 1, [&](std::size_t k) { rows[k] = rowOf(terrain, grid, first + static_cast<std::uint32_t>(k), watch.stop); });
    for (const std::vector<float>& row : rows)
      out.write(reinterpret_cast<const char*>(row.data()), static_cast<std::streamsize>(row.size() * sizeof(float)));
    if (progress) ++progress->part;
  }
  return static_cast<bool>(out.flush());
}

}  // namespace

Result<std::string> writeGeoTiff(const terrain::Terrain& terrain, const OfGrid& grid, bool tellsPlace, const std::string& description,
                                 scheduling::Pool& pool, const box::Watch& watch, Progress* progress) {
  expects(grid.sheet.pixels() > 0 && grid.sheet.nodes.empty(), "a grid has samples in straight rows");
  expects(!grid.first || terrain.raster(), "samples of a height map are in one");
  auto gdal = raster::Gdal::find("GDAL's programs write GeoTIFFs", watch.stop);
  if (!gdal) return Problem{Problem::Kind::kFailed, gdal.error().message + "."};
  if (!writeSamples(terrain, grid, gdal->file("heights.f32"), pool, watch, progress)) return noRoom();
  if (watch.over()) return watch.problem();
  const auto source = gdal->file("heights.vrt"), made = gdal->file("made.tif");
  std::ofstream(source) << virtualFile(grid.sheet, tellsPlace ? terrain.raster() : nullptr, description);
  if (progress) progress->stage = Progress::Stage::kWriting;
  const std::uint64_t most = (1 << 20) + 8 * std::uint64_t{grid.sheet.columns} * grid.sheet.rows;
  const auto written = gdal->run("gdal_translate",
                                 {"-q", "-of", "COG", "-co", "COMPRESS=DEFLATE", "-co", "PREDICTOR=YES", "-co", "BIGTIFF=IF_SAFER", "-co",
                                  "OVERVIEW_RESAMPLING=AVERAGE", source.string(), made.string()},
                                 most);
  if (watch.over()) return watch.problem();
  if (!written)
    return Problem{Problem::Kind::kFailed, "GDAL could not write the file: " + text::withoutFolders(written.error().message) + "."};
  auto bytes = text::readFile(made, most);
  if (!bytes) return noRoom();
  return {boost::system::in_place_value, std::move(*bytes)};
}

}  // namespace ridgecast::snapshot
