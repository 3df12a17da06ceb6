#pragma once
// A terrain: two functions of a position on the horizontal plane, height and colour, written once in GLSL. The file is compiled into the
// program as C++ for heights, and sent to clients as text for the ray march and shading.
//
// The contract of a terrain file (see common/terrain/README.md):
//   float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed)
//       metres. `cell` counts squares of 4,096 m (it wraps), `fraction` in [0, 1) has 20 bits. `footprint` is the width in metres that
//       one sample stands for: detail finer than it fades out. Geometry always uses footprint 0; only shading filters.
//   vec3  terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed)
//       linear RGB albedo, 0..1.
//   int   terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, uint seed)
//       what the ground is made of (materials.h); absent: it is not said.
// Heights are bit for bit the same from every code path and, without fused multiply-add, from the graphics driver.

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::terrain {

class Raster;

// Linear red, green and blue at `count` points with these heights (metres) and unit normals, as seen by samples `footprint` metres wide.
using Colours = std::function<void(const lattice::Step* x, const lattice::Step* z, const float* height, const std::array<float, 3>* normal,
                                   float footprint, std::array<float, 3>* out, std::size_t count, std::uint32_t seed)>;

// Rounded to the nearest step and clamped to +-lattice::kMaxHeight; NaN becomes 0.
std::int32_t toSteps(float metres);

// What is known of heights between places, so that rays need not look everywhere (common/ground).
struct Relief {
  enum class Known {
    kSampled,   // nothing
    kMeasured,  // noise: as uneven between samples as from one sample to the next
    kProven,    // Terrain::raster() with its bicubic between samples (raster_cubic.glsl)
  };
  Known known = Known::kSampled;
  double lowest = 0, highest = 0;  // metres: no height lies beyond, but for edits; of kSampled: 0
};
inline constexpr std::string_view kKnownNames[] = {"sampled", "measured", "proven"};

// What others keep with a terrain while it lives.
class Kept {
 public:
  virtual ~Kept() = default;
};

// A terrain with its seed. Immutable; every member may be called from any thread.
class Terrain {
 public:
  Terrain() = default;
  Terrain(const Terrain&) {}  // what is kept stays with the other
  Terrain& operator=(const Terrain&) = delete;
  virtual ~Terrain() { delete kept_.load(); }
  virtual std::string_view name() const = 0;
  virtual std::string_view source() const = 0;  // the GLSL text of the terrain file
  virtual std::uint32_t seed() const = 0;
  virtual const Raster* raster() const { return nullptr; }   // the samples of a height map (raster.h); null: heights are a formula
  virtual const Raster* edits() const { return nullptr; }    // posts whose bicubic is added to other heights; null: none
  virtual Colours colours() const { return {}; }             // empty: not available in C++ (some users' files)
  virtual Relief relief() const { return {}; }               // without edits
  virtual const Terrain& unedited() const { return *this; }  // the same without edits; lives as long
  virtual std::span<const std::string> ownMaterials() const { return {}; }  // names, at most kMaxOwnMaterials

  // What common/ground keeps here, made at the first call.
  Kept& kept(std::unique_ptr<Kept> (*make)(const Terrain&)) const;

  // Heights in metres at points of the lattice, as the terrain function returns them. x, z, out have the same size.
  virtual void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const = 0;

  // What the ground is made of at points of the lattice (materials.h). x, z, out have the same size.
  virtual void materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const;

  // The heights by toSteps().
  void heightSteps(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::int32_t> out) const;
  std::int32_t heightStep(lattice::Point p) const;
  double height(lattice::Point p) const;  // metres, of heightStep

 private:
  mutable std::atomic<Kept*> kept_ = nullptr;
};

struct Description {
  std::string_view name;
  std::string_view summary;  // one line for people
  std::string_view source;   // the GLSL text
  std::size_t parameters;    // how many the text declares
  double lowest, highest;    // metres: no height lies beyond, whatever the parameters within their ranges
};
std::span<const Description> builtIn();

// Other values of a built-in terrain's parameters, in the order of the file, and its text with them. Empty: the file's own.
struct Parameters {
  std::vector<float> values;  // Description::parameters of them
  std::string source;
};

// Error: unknown name; the message lists the names there are.
Outcome<std::shared_ptr<const Terrain>> create(std::string_view name, std::uint32_t seed, Parameters parameters = {});

// A hash of source text, seed and lattice version: equal for equal worlds.
std::uint64_t contentHash(const Terrain& terrain);

// GLSL that every terrain file may call (noise on the lattice), and GLSL that draws a terrain (filtered normal, light, sky, fog). Both
// renderings compile: version line, prelude(), the terrain's source(), shading(), then their own main.
std::string_view prelude();
std::string_view shading();

// GLSL before and after a terrain's source that adds edits to its heights and colours (edited.glsl says what it needs).
std::string_view beforeEdited();
std::string edited();

// The texts around a terrain file that is compiled at run time (common/glsl): GLSL as C++ before prelude(), the loop over points
// after the file.
std::string_view glslAsCpp();
std::string_view batch();

inline constexpr std::uint32_t kDefaultSpacing = 16;  // steps: 1/16 m
// Unit normals (x, y, z of each place) of the plane through the heights `spacing` steps to each side, 0: kDefaultSpacing: along x and along
// z, the slope between the two. `out` has three times the size of x and z. Positions within `spacing` of the lattice's end use the end.
void normals(const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::uint32_t spacing,
             std::span<float> out);

// Curvature at points: the height function convolved with a 3 x 3 Laplacian of Gaussian (sigma 1, zero sum, normalised to unit absolute
// sum; Lee et al.), with samples `spacing` steps apart. Metres, absolute value.
void curvatures(const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, lattice::Step spacing,
                std::span<float> out);

}  // namespace ridgecast::terrain
