// An edit, packed or as JSON: refused in a sentence, or an operation that comes back as it was and that the ground takes, and gives up
// again.
#include <array>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <string_view>

#include "common/edits/history.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"

namespace {

using namespace ridgecast;

class Level final : public terrain::Terrain {
 public:
  std::string_view name() const override { return "level"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    for (float& h : out) h = 100;
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto level = std::make_shared<const Level>();
  const std::string_view text{reinterpret_cast<const char*>(data), size};
  const auto packed = edits::unpack(text);
  if (packed && edits::pack(*packed) != text) std::abort();
  const auto toWorld = [](const std::string& crs, double first, double second) -> Outcome<std::array<double, 2>> {
    if (crs != "lonlat") return Error{"crs is lonlat."};
    return std::array{first * 100'000, second * -100'000};
  };
  const auto operation = packed ? packed : edits::fromJson(text, toWorld);
  if (!operation) {
    if (operation.error().message.empty()) std::abort();
    return 0;
  }
  if (const auto again = edits::fromJson(edits::toJson(*operation)); !packed && (!again || !(*again == *operation))) std::abort();
  if (const auto again = edits::unpack(edits::pack(*operation)); !again || !(*again == *operation)) std::abort();
  if (edits::areaOf(*operation).count() > 40'000) return 0;  // the same, slower
  edits::History history(level);
  auto prepared = history.prepare(*operation);
  if (!prepared) return 0;  // an undo of nothing
  const auto changed = history.add(*prepared);
  if (!changed) std::abort();
  const auto first = history.layer()->addresses();
  for (const edits::TileAddress& tile : first)
    if (!tile.posts().wider(2 * edits::kTileSide).meets(*changed)) std::abort();
  if (!history.add({edits::Undo{1}, 0}) || !history.layer()->empty()) std::abort();
  return 0;
}
