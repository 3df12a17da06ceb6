// A height tile's bytes: what decodes is the same again after coding.
#include <cstdint>
#include <cstdlib>

#include "common/terrain/raster.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ridgecast;
  const auto tile = terrain::decodeTile({data, size});
  if (!tile) return tile.error().message.empty() ? std::abort(), 0 : 0;
  if (*terrain::decodeTile(terrain::encodeTile(*tile)) != *tile) std::abort();
  return 0;
}
