#include "common/glsl/compiled.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "common/glsl/check.h"
#include "common/glsl/complaints.h"
#include "common/glsl/library.h"
#include "common/glsl/probe.h"
#include "common/outcome/contract.h"
#include "common/process/scratch.h"
#include "common/terrain/materials.h"
#include "common/terrain/variants.h"

namespace ridgecast::glsl {
namespace {

std::size_t mostOf(const std::vector<std::string>& ownMaterials) { return terrain::kMaterials.size() + ownMaterials.size(); }

class Compiled final : public terrain::Terrain {
 public:
  Compiled(Source source, std::vector<std::string> materials, std::uint32_t seed, std::shared_ptr<const Library> library, Complain complain)
      : source_(std::move(source)),
        ownMaterials_(std::move(materials)),
        seed_(seed),
        library_(std::move(library)),
        complain_(std::move(complain)) {}
  std::string_view name() const override { return source_.name; }
  std::string_view source() const override { return source_.text; }
  std::uint32_t seed() const override { return seed_; }
  terrain::Colours colours() const override { return library_->colours() ? terrain::asColours(library_->colours()) : terrain::Colours(); }
  std::span<const std::string> ownMaterials() const override { return ownMaterials_; }
  void materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const override {
    if (!library_->materials()) return Terrain::materials(x, z, out);
    terrain::materialsBy([&](auto... places) { library_->materials()(places..., seed_); }, *this, x, z, out);
    for (std::size_t k = 0; k < out.size(); ++k) {
      if (out[k] <= mostOf(ownMaterials_)) continue;
      if (!toldMaterial_.exchange(true, std::memory_order_relaxed) && complain_)
        complain_(source_.file + ": the material at " + placeText(x[k], z[k]) + " " + materialFault(mostOf(ownMaterials_)) +
                  "; taken for 0, here and wherever it happens again");
      out[k] = 0;
    }
  }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    const std::size_t count = out.size();
    expects(x.size() == count && z.size() == count, "each place has its height");
    library_->heights()(x.data(), z.data(), out.data(), count, seed_);
    constexpr float kMax = static_cast<float>(lattice::kMaxHeight * lattice::kMetresPerStep);
    bool fine = true;
    for (std::size_t i = 0; i < count; ++i) fine &= std::abs(out[i]) <= kMax;  // false also for NaN
    if (fine) return;
    for (std::size_t i = 0; i < count; ++i) {
      const std::string_view fault = faultOf(out[i]);
      if (fault.empty()) continue;
      if (!told_.exchange(true, std::memory_order_relaxed) && complain_)
        complain_(source_.file + ": the height at " + placeText(x[i], z[i]) + " " + std::string(fault) + "; taken for " +
                  (std::isnan(out[i]) ? "0" : "the nearest that is possible") + ", here and wherever it happens again");
      out[i] = std::isnan(out[i]) ? 0.0f : std::clamp(out[i], -kMax, kMax);
    }
  }

 private:
  Source source_;
  std::vector<std::string> ownMaterials_;
  std::uint32_t seed_;
  std::shared_ptr<const Library> library_;
  Complain complain_;
  mutable std::atomic<bool> told_ = false, toldMaterial_ = false;
};

// The fault that probe() found, at the expression it comes from, or at least at the function.
Error withPlace(const Error& fault, const Source& source, std::size_t mostMaterial, std::uint32_t seed, const Build& build,
                const std::stop_token& stop) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  if (fault.message.find(faultOf(kInfinity - kInfinity)) == std::string::npos &&
      fault.message.find(faultOf(kInfinity)) == std::string::npos)
    return fault;
  const auto checked = checkGlsl(source.file, source.text, stop);
  if (!checked) return fault;
  const bool isColour = fault.message.find(kTheColour) != std::string::npos;
  const auto function = std::ranges::find_if(checked->items, [&](const TopLevel& item) {
    return item.what == TopLevel::What::kFunction && item.names[0] == (isColour ? "terrainColor" : "terrainHeight");
  });
  expects(function != checked->items.end(), "a file that passed its check has both functions");
  Error atFunction{at(source.file, function->line) + fault.message.substr(source.file.size() + 2)};
  if (isColour) return atFunction;
  auto translated = translate(source.file, checked->tokens, checked->items);
  const auto scratch = process::Scratch::create();
  if (!translated || !scratch) return atFunction;
  const std::filesystem::path library = scratch->path() / "traced.so";
  translated->traced = true;
  if (!compile(source.file, *translated, "baseline", library, stop)) return atFunction;
  const auto again = probe(source.file, library, mostMaterial, seed, build.prober, stop);
  return again || again.error().message == fault.message ? atFunction : again.error();
}

struct Built {
  std::shared_ptr<const Library> library;
  std::string advice;
};

Outcome<Built> built(const Source& source, std::size_t mostMaterial, std::uint32_t seed, const Build& build, const std::stop_token& stop) {
  const std::string variant = build.variant.empty() ? std::string(terrain::variants().back().name) : build.variant;
  auto cache = Cache::open(build.cache);
  std::optional<process::Scratch> once;  // without a cache folder, compile every time; a loaded library survives the removal of its file
  if (!cache && build.cache.empty()) {
    auto made = process::Scratch::create();
    if (!made) return made.error();
    once.emplace(std::move(*made));
    cache = Cache::open(once->path());
  }
  if (!cache) return cache.error();
  // With colours if they can be compiled as C++, for snapshots. Only a private terrain requires them.
  const auto make = [&](bool colours) -> Outcome<std::filesystem::path> {
    std::filesystem::path file = cache->fileFor(source.text, variant, colours);
    // By a name that no loaded library has, so that dlopen looks at the file itself.
    if (cache->has(file) && Library::open(file.parent_path() / "." / file.filename()))
      return {boost::system::in_place_value, std::move(file)};
    auto checked = checkGlsl(source.file, source.text, stop);
    if (!checked) return checked.error();
    auto translated = translate(source.file, checked->tokens, checked->items, colours);
    if (!translated) return translated.error();
    if (auto compiled = compile(source.file, *translated, variant, file, stop); !compiled) return compiled.error();
    cache->trim();
    return {boost::system::in_place_value, std::move(file)};
  };
  auto file = make(true);
  if (!file && !build.colours && !stop.stop_requested()) file = make(false);
  if (!file) return file.error();
  auto fine = probe(source.file, *file, mostMaterial, seed, build.prober, stop);
  if (!fine) return withPlace(fine.error(), source, mostMaterial, seed, build, stop);
  auto library = Library::open(*file);
  if (!library) return library.error();
  return Built{std::move(*library), std::move(*fine)};
}

}  // namespace

Outcome<std::shared_ptr<const terrain::Terrain>> load(Source source, const std::vector<Assignment>& parameters, std::uint32_t seed,
                                                      const Build& build, Complain complain, const std::stop_token& stop) {
  const auto wrong = [&](const Error& error) { return Error{explained(source.file, source.text, error.message)}; };
  if (auto fine = checkText(source.file, source.text); !fine) return wrong(fine.error());
  auto declaration = readDeclaration(source.file, source.text);
  if (!declaration) return wrong(declaration.error());
  auto text = withParameters(source.file, source.text, *declaration, parameters);
  if (!text) return text.error();
  source.text = std::move(*text);
  auto made = built(source, mostOf(declaration->materials), seed, build, stop);
  if (!made) return wrong(made.error());
  for (const std::string& better : {advice(source.file, source.text), made->advice})
    if (complain && !better.empty()) complain(better);
  return std::shared_ptr<const terrain::Terrain>(std::make_shared<Compiled>(std::move(source), std::move(declaration->materials), seed,
                                                                            std::move(made->library), std::move(complain)));
}

}  // namespace ridgecast::glsl
