#include "common/terrain/terrain.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "common/outcome/contract.h"
#include "common/terrain/embedded.h"
#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace {

// Part of contentHash. Change it if the same text and seed give other heights on the lattice.
constexpr std::uint64_t kLatticeVersion = 1;

// Lowest and highest: the sums of what each octave adds at most.
const std::array<Description, kBuiltIns> kBuiltIn = {
    {{"alpine", "ridged, eroded mountains with lakes, meadows, scree and snow", embedded::alpine, 2, 420, 3300},
     {"canyon", "a plateau of layered rock, cut into mesas, terraces and gorges", embedded::canyon, 1, 0, 1300},
     {"archipelago", "wooded islands with hills, dunes and beaches in a shallow sea", embedded::archipelago, 1, 0, 2600}}};

// As each terrain's _material.glsl numbers them.
const std::array<std::vector<std::string>, kBuiltIns> kOwnMaterials = {{{"water", "wood"}, {"water", "scrub"}, {"water", "wood", "heath"}}};

std::vector<Variant> usableVariants() {
  std::vector<Variant> usable{baselineVariant()};
#ifdef RIDGECAST_TERRAIN_X86
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2")) usable.push_back(avx2Variant());
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    usable.push_back(avx512Variant());
  }
#endif
  return usable;
}

class BuiltIn final : public Terrain {
 public:
  BuiltIn(std::size_t index, std::uint32_t seed, Parameters parameters)
      : index_(index), seed_(seed), parameters_(std::move(parameters)), functions_(variants().back().terrain[index]) {
    expects(parameters_.values.empty() || parameters_.values.size() == kBuiltIn[index].parameters, "a terrain has all its parameters");
  }
  std::string_view name() const override { return kBuiltIn[index_].name; }
  std::string_view source() const override { return parameters_.values.empty() ? kBuiltIn[index_].source : parameters_.source; }
  std::uint32_t seed() const override { return seed_; }
  Relief relief() const override { return {Relief::Known::kMeasured, kBuiltIn[index_].lowest, kBuiltIn[index_].highest}; }
  Colours colours() const override {
    return [f = functions_.colours, values = parameters_.values](const lattice::Step* x, const lattice::Step* z, const float* height,
                                                                 const std::array<float, 3>* normal, float footprint,
                                                                 std::array<float, 3>* out, std::size_t count, std::uint32_t seed) {
      f(x, z, height, normal->data(), footprint, out->data(), count, seed, orNull(values));
    };
  }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    expects(x.size() == out.size() && z.size() == out.size(), "each place has its height");
    functions_.heights(x.data(), z.data(), out.data(), out.size(), seed_, orNull(parameters_.values));
  }
  std::span<const std::string> ownMaterials() const override { return kOwnMaterials[index_]; }
  void materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const override {
    materialsBy([&](auto... places) { functions_.materials(places..., seed_, orNull(parameters_.values)); }, *this, x, z, out);
  }

 private:
  static const float* orNull(const std::vector<float>& values) { return values.empty() ? nullptr : values.data(); }
  std::size_t index_;
  std::uint32_t seed_;
  Parameters parameters_;
  Functions functions_;
};

}  // namespace

std::int32_t toSteps(float metres) {
  if (std::isnan(metres)) return 0;
  // A float times 256 is exact in a double, and so is the sum with one half.
  const double steps = std::floor(static_cast<double>(metres) * lattice::kStepsPerMetre + 0.5);
  return static_cast<std::int32_t>(std::clamp(steps, -double{lattice::kMaxHeight}, double{lattice::kMaxHeight}));
}

std::span<const Variant> variants() {
  static const std::vector<Variant> usable = usableVariants();
  return usable;
}

Kept& Terrain::kept(std::unique_ptr<Kept> (*make)(const Terrain&)) const {
  Kept* there = kept_.load(std::memory_order_acquire);
  if (there) return *there;
  std::unique_ptr<Kept> made = make(*this);
  if (kept_.compare_exchange_strong(there, made.get(), std::memory_order_acq_rel)) return *made.release();
  return *there;  // another thread was first
}

void normals(const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::uint32_t spacing,
             std::span<float> out) {
  expects(z.size() == x.size() && out.size() == 3 * x.size(), "each place has its normal");
  constexpr std::size_t kBatch = 64;  // 256 heights a call
  const lattice::Step s = spacing == 0 ? kDefaultSpacing : spacing;
  std::array<lattice::Step, 4 * kBatch> sampleX, sampleZ;
  std::array<float, 4 * kBatch> height;
  const auto within = [](lattice::Step v) { return std::clamp(v, -lattice::kMaxPosition, lattice::kMaxPosition); };
  for (std::size_t begin = 0; begin < x.size(); begin += kBatch) {
    const std::size_t n = std::min(kBatch, x.size() - begin);
    for (std::size_t k = 0; k < n; ++k) {
      const lattice::Step atX = x[begin + k], atZ = z[begin + k];
      sampleX[k] = within(atX - s), sampleZ[k] = atZ;
      sampleX[n + k] = within(atX + s), sampleZ[n + k] = atZ;
      sampleX[2 * n + k] = atX, sampleZ[2 * n + k] = within(atZ - s);
      sampleX[3 * n + k] = atX, sampleZ[3 * n + k] = within(atZ + s);
    }
    terrain.heights(std::span(sampleX).first(4 * n), std::span(sampleZ).first(4 * n), std::span(height).first(4 * n));
    for (std::size_t k = 0; k < n; ++k) {
      const double acrossX = static_cast<double>(sampleX[n + k] - sampleX[k]) * lattice::kMetresPerStep;
      const double acrossZ = static_cast<double>(sampleZ[3 * n + k] - sampleZ[2 * n + k]) * lattice::kMetresPerStep;
      const double slopeX = (static_cast<double>(height[n + k]) - height[k]) / acrossX;
      const double slopeZ = (static_cast<double>(height[3 * n + k]) - height[2 * n + k]) / acrossZ;
      const double length = std::sqrt(slopeX * slopeX + 1.0 + slopeZ * slopeZ);
      float* normal = &out[3 * (begin + k)];
      normal[0] = static_cast<float>(-slopeX / length);
      normal[1] = static_cast<float>(1.0 / length);
      normal[2] = static_cast<float>(-slopeZ / length);
    }
  }
}

void Terrain::materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const {
  expects(x.size() == out.size() && z.size() == out.size(), "each place has its material");
  std::ranges::fill(out, std::uint8_t{0});
}

void Terrain::heightSteps(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::int32_t> out) const {
  expects(x.size() == out.size() && z.size() == out.size(), "each place has its height");
  std::array<float, 256> metres;
  for (std::size_t begin = 0; begin < out.size(); begin += metres.size()) {
    const std::size_t n = std::min(metres.size(), out.size() - begin);
    heights(x.subspan(begin, n), z.subspan(begin, n), std::span(metres).first(n));
    for (std::size_t i = 0; i < n; ++i) out[begin + i] = toSteps(metres[i]);
  }
}

std::int32_t Terrain::heightStep(lattice::Point p) const {
  std::int32_t out = 0;
  heightSteps(std::span(&p.x, 1), std::span(&p.z, 1), std::span(&out, 1));
  return out;
}

double Terrain::height(lattice::Point p) const { return heightStep(p) * lattice::kMetresPerStep; }

std::span<const Description> builtIn() { return kBuiltIn; }

Outcome<std::shared_ptr<const Terrain>> create(std::string_view name, std::uint32_t seed, Parameters parameters) {
  for (std::size_t i = 0; i < kBuiltIn.size(); ++i)
    if (name == kBuiltIn[i].name) return std::shared_ptr<const Terrain>(std::make_shared<BuiltIn>(i, seed, std::move(parameters)));
  std::string names;
  for (const Description& d : kBuiltIn) names.append(names.empty() ? "" : ", ").append(d.name);
  return Error{"there is no terrain \"" + std::string(name.substr(0, 64)) + "\"; there is: " + names};
}

std::uint64_t contentHash(const Terrain& terrain) {
  std::uint64_t hash = lattice::mix(kLatticeVersion) ^ terrain.seed();
  hash = lattice::mix(hash);
  for (const std::string_view text : {prelude(), terrain.source()}) {
    for (const char c : text) hash = lattice::mix(hash ^ static_cast<unsigned char>(c));
    hash = lattice::mix(hash ^ text.size());
  }
  return hash;
}

std::string_view prelude() { return embedded::prelude; }
std::string_view shading() { return embedded::shading; }

std::string_view beforeEdited() { return embedded::edited_before; }

std::string edited() { return std::string(embedded::edited).append(embedded::raster_cubic).append(embedded::material_color); }
std::string_view glslAsCpp() { return embedded::glsl_as_cpp; }
std::string_view batch() { return embedded::batch; }

void curvatures(const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, lattice::Step spacing,
                std::span<float> out) {
  expects(x.size() == out.size() && z.size() == out.size() && spacing > 0, "each place has its curvature, of samples apart");
  // Laplacian of Gaussian at sigma 1, (r^2 - 2) exp(-r^2 / 2) at r^2 = 0, 1, 2 for centre, edges and corners. Subtracting the mean of the
  // nine makes them sum to zero; then all are divided by the sum of their absolute values.
  constexpr double kRaw[3] = {-2.0, -0.60653065971263342, 0.0};
  constexpr double kMean = (kRaw[0] + 4 * kRaw[1] + 4 * kRaw[2]) / 9;
  constexpr double kCentre = kRaw[0] - kMean, kEdge = kRaw[1] - kMean, kCorner = kRaw[2] - kMean;
  constexpr double kAbsolute = -kCentre - 4 * kEdge + 4 * kCorner;
  static_assert(kCentre < 0 && kEdge < 0 && kCorner > 0);
  constexpr std::size_t kBatch = 28;  // points; 252 heights a call fill one block of the evaluator
  std::array<lattice::Step, kBatch * 9> sampleX;
  std::array<lattice::Step, kBatch * 9> sampleZ;
  std::array<float, kBatch * 9> h;
  for (std::size_t begin = 0; begin < out.size(); begin += kBatch) {
    const std::size_t n = std::min(kBatch, out.size() - begin);
    std::size_t k = 0;
    for (std::size_t i = 0; i < n; ++i) {
      for (int dz = -1; dz <= 1; ++dz) {
        for (int dx = -1; dx <= 1; ++dx, ++k) {
          sampleX[k] = x[begin + i] + dx * spacing;
          sampleZ[k] = z[begin + i] + dz * spacing;
        }
      }
    }
    terrain.heights(std::span(sampleX).first(k), std::span(sampleZ).first(k), std::span(h).first(k));
    for (std::size_t i = 0; i < n; ++i) {
      // Differences from the centre, so that a level plane gives exactly 0 at any height.
      const float* s = &h[i * 9];
      const double c = s[4];
      const double edges = (s[1] - c) + (s[3] - c) + (s[5] - c) + (s[7] - c);
      const double corners = (s[0] - c) + (s[2] - c) + (s[6] - c) + (s[8] - c);
      out[begin + i] = static_cast<float>(std::abs((edges * kEdge + corners * kCorner) / kAbsolute));
    }
  }
}

}  // namespace ridgecast::terrain
