#include "server/map/tile.h"

#include <cstdint>
#include <vector>

#include "server/map/mercator.h"
#include "server/map/picture.h"

namespace ridgecast::map {

std::string heightTile(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop) {
  const std::vector<float> metres = heights(terrain, sheet, stop);
  if (metres.empty()) return {};
  std::vector<std::uint8_t> rgb(3 * metres.size());
  for (std::size_t k = 0; k < metres.size(); ++k) terrarium(metres[k], &rgb[3 * k]);
  return png(rgb, sheet.columns, sheet.rows);
}

std::string colourTile(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop) {
  const auto rgb = colours(terrain, sheet, stop);
  return rgb.empty() ? std::string() : jpeg(rgb, sheet.columns, sheet.rows);
}

}  // namespace ridgecast::map
