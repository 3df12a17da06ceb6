#include "server/check_command.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <iostream>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "common/glsl/declaration.h"
#include "common/raster/raster_terrain.h"
#include "common/terrain/materials.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"
#include "common/text/text.h"
#include "common/user_terrain/catalogue.h"
#include "server/config/config.h"

namespace ridgecast {
namespace {

constexpr const char* kHelp = R"(Usage: ridgecast-server check FILE [SETTINGS]

Tries a terrain as a server would that is started with it, and says what it is, for example
  ridgecast-server check dunes.glsl --param tallest=300

  FILE      a terrain file (.glsl), a height map, or the name of a terrain (--list-terrains)
  SETTINGS  those of ridgecast-server that name the terrain

Exit status: 0; 2 if a server would refuse it.
)";

constexpr std::size_t kPlaces = 1 << 16;
constexpr lattice::Step kReach = lattice::Step{50'000} << lattice::kStepBits;

int refuse(const std::string& sentence) {
  std::cerr << "ridgecast-server check: " << sentence << "\n";
  return 2;
}

struct Places {
  std::vector<lattice::Step> x, z;
};

// Of a height map, or within kReach.
Places randomPlaces(const terrain::Terrain& terrain) {
  lattice::Area area{-kReach, -kReach, kReach, kReach};
  if (terrain.raster()) area = terrain.raster()->shape().area();
  std::mt19937_64 random(1);
  const auto between = [&random](lattice::Step from, lattice::Step to) { return std::uniform_int_distribution(from, to)(random); };
  Places out;
  for (std::size_t k = 0; k < kPlaces; ++k) out.x.push_back(between(area.x0, area.x1 - 1)), out.z.push_back(between(area.z0, area.z1 - 1));
  return out;
}

// "sand 71 %, rock 28 %, not said 1 %"
std::string madeOf(const terrain::Terrain& terrain, const Places& places) {
  std::vector<std::uint8_t> materials(kPlaces);
  terrain.materials(places.x, places.z, materials);
  std::array<std::size_t, 256> count{};
  for (const std::uint8_t material : materials) ++count[material];
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < count.size(); ++k)
    if (count[k] > 0) order.push_back(k);
  if (order == std::vector<std::size_t>{0}) return {};
  std::ranges::sort(order, std::ranges::greater(), [&](std::size_t k) { return count[k]; });
  std::string out;
  for (const std::size_t k : order) {
    const std::string_view name = terrain::materialName(static_cast<std::uint8_t>(k), terrain.ownMaterials());
    out.append(out.empty() ? "" : ", ").append(name.empty() ? "not said" : name).append(" ");
    out.append(text::rounded(100.0 * static_cast<double>(count[k]) / kPlaces, 2)).append(" %");
  }
  return out;
}

int check(const config::Config& config) {
  const auto terrain = user_terrain::load(config.terrain, [](const std::string& advice) { std::cerr << advice << "\n"; });
  if (!terrain) return refuse(terrain.error().message);
  const terrain::Terrain& made = **terrain;
  const Places places = randomPlaces(made);
  std::vector<float> heights(kPlaces);
  const auto begin = std::chrono::steady_clock::now();
  made.heights(places.x, places.z, heights);
  const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - begin;
  const auto [lowest, highest] = std::ranges::minmax(heights);
  std::cout << config.terrain.terrain << " can be served: " << text::rounded(static_cast<double>(lowest), 5) << " to "
            << text::rounded(static_cast<double>(highest), 5) << " m high at " << kPlaces << " places "
            << (made.raster() ? "of the map" : "within 50 km") << ", a height takes " << text::rounded(took.count() / kPlaces, 2)
            << " ns\n";
  if (const terrain::Raster* map = made.raster()) {
    std::cout << "    " << raster::describe(*map) << "\n";
  } else if (const auto declared = glsl::readDeclaration(config.terrain.terrain, made.source())) {
    if (!declared->summary.empty()) std::cout << "    " << declared->summary << "\n";
    for (const glsl::Parameter& p : declared->parameters) std::cout << "    --param " << glsl::describe(p) << "\n";
  }
  if (const std::string materials = madeOf(made, places); !materials.empty()) std::cout << "    made of " << materials << "\n";
  return std::cout.flush() ? 0 : 1;
}

}  // namespace

int runCheckCommand(int argc, const char* const* argv, const char* const* environment) {
  if (std::any_of(argv, argv + argc, [](std::string_view a) { return a == "--help" || a == "-h"; }))
    return std::cout << kHelp << std::flush ? 0 : 1;
  if (argc < 2 || std::string_view(argv[1]).starts_with("-"))
    return refuse("Say FILE, then settings: ridgecast-server check dunes.glsl; see --help.");
  std::vector<const char*> settings{argv[0], "--terrain", argv[1]};
  settings.insert(settings.end(), argv + 2, argv + argc);
  const config::Parsed parsed = config::parse(static_cast<int>(settings.size()), settings.data(), environment);
  return parsed.config ? check(*parsed.config) : parsed.status;
}

}  // namespace ridgecast
