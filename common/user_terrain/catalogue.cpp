#include "common/user_terrain/catalogue.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "common/terrain/variants.h"
#include "common/text/file.h"
#include "common/text/text.h"
#include "common/user_terrain/check.h"
#include "common/user_terrain/complaints.h"
#include "common/user_terrain/library.h"
#include "common/user_terrain/probe.h"
#include "common/user_terrain/raster_terrain.h"
#include "common/user_terrain/scratch.h"

namespace ridgecast::user_terrain {
namespace {

struct Source {
  std::string name;  // of the terrain
  std::string file;  // for messages
  std::string text;
};

class Compiled final : public terrain::Terrain {
 public:
  Compiled(Source source, std::uint32_t seed, std::shared_ptr<const Library> library, Complain complain)
      : source_(std::move(source)), seed_(seed), library_(std::move(library)), complain_(std::move(complain)) {}
  std::string_view name() const override { return source_.name; }
  std::string_view source() const override { return source_.text; }
  std::uint32_t seed() const override { return seed_; }
  terrain::Colours colours() const override { return library_->colours() ? terrain::asColours(library_->colours()) : terrain::Colours(); }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    const std::size_t count = std::min({x.size(), z.size(), out.size()});
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
  std::uint32_t seed_;
  std::shared_ptr<const Library> library_;
  Complain complain_;
  mutable std::atomic<bool> told_ = false;
};

// A line that ends in a backslash goes on in the next, which not every client's GLSL knows. Lines keep their numbers.
std::string withLinesJoined(std::string_view text) {
  std::string out;
  std::size_t open = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.substr(i).starts_with("\\\n")) {
      ++open, ++i;
      continue;
    }
    out += text[i];
    if (text[i] == '\n') out.append(std::exchange(open, 0), '\n');
  }
  return out;
}

Outcome<std::string> readText(const std::filesystem::path& file) {
  std::error_code failed;
  const auto status = std::filesystem::status(file, failed);
  if (failed || !std::filesystem::is_regular_file(status)) return Error{"there is no file " + file.string()};
  auto text = text::readFile(file, kMaxText);
  if (!text) return Error{"cannot read " + file.string()};
  if (text->size() > kMaxText)
    return Error{file.string() + ": the file has " + std::to_string(std::filesystem::file_size(file, failed)) +
                 " bytes; a terrain file has at most " + std::to_string(kMaxText)};
  if (text->starts_with("\xef\xbb\xbf")) text->erase(0, 3);
  std::erase(*text, '\r');
  return {boost::system::in_place_value, withLinesJoined(*text)};
}

const terrain::Description* builtIn(std::string_view name) {
  for (const terrain::Description& d : terrain::builtIn())
    if (d.name == name) return &d;
  return nullptr;
}

constexpr std::size_t kMaxName = 128;  // clients ask for no longer ones

bool isGlsl(const std::filesystem::path& file) { return file.extension() == ".glsl"; }

// Those that are terrains, by name.
std::vector<std::filesystem::path> filesIn(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> out;
  std::error_code failed;
  if (folder.empty()) return out;
  for (const auto& entry : std::filesystem::directory_iterator(folder, failed))
    if ((isGlsl(entry.path()) || isRasterName(entry.path().string())) && entry.is_regular_file(failed)) out.push_back(entry.path());
  std::ranges::sort(out);
  return out;
}

// What keeps a file of a folder from being a terrain by its name; empty: nothing.
std::string problemOf(const std::filesystem::path& file, const std::vector<std::filesystem::path>& all) {
  const std::string name = file.stem().string(), begin = file.string() + ": ";
  if (builtIn(name)) return begin + name + " is the name of a built-in terrain; rename the file";
  if (name.size() > kMaxName || !text::hasOnly(name, "_-"))
    return begin + "rename it: a terrain's name has up to " + std::to_string(kMaxName) + " letters, digits, underscores or hyphens";
  for (const auto& other : all)
    if (other.stem() == file.stem() && other != file)
      return begin + "rename it or " + other.filename().string() + ": two terrains cannot have the name " + name;
  return {};
}

// Of this terrain; empty: it is built in.
Outcome<std::filesystem::path> fileOf(const Request& request) {
  using Found = Outcome<std::filesystem::path>;
  if (builtIn(request.terrain)) return Found(boost::system::in_place_value);
  const std::filesystem::path file = request.terrain;
  std::error_code failed;
  if (isGlsl(file) || isRasterName(request.terrain) || (file.has_parent_path() && std::filesystem::exists(file, failed)))
    return Found(boost::system::in_place_value, file);
  const auto all = filesIn(request.folder);
  const auto found = std::ranges::find(all, file.string(), [](const std::filesystem::path& f) { return f.stem().string(); });
  if (found != all.end()) {
    if (std::string problem = problemOf(*found, all); !problem.empty()) return Error{std::move(problem)};
    return Found(boost::system::in_place_value, *found);
  }
  std::string names;
  for (const terrain::Description& d : terrain::builtIn()) names.append(names.empty() ? "" : ", ").append(d.name);
  for (const auto& f : all) names.append(", ").append(f.stem().string());
  return Error{"there is no terrain \"" + request.terrain.substr(0, 64) + "\"; there is: " + names +
               "; or give a file of your own: NAME.glsl, or a height map, such as NAME.tif, or a folder of them, FOLDER/"};
}

std::filesystem::path settingsOf(std::filesystem::path map) { return map.replace_extension(".raster"); }

// How a map is to be read: by the settings beside it, or as the request says.
Outcome<RasterOptions> optionsOf(const std::filesystem::path& map, const RasterOptions& asked) {
  const std::filesystem::path file = settingsOf(map);
  std::error_code failed;
  if (!std::filesystem::exists(file, failed)) return asked;
  if (asked != RasterOptions())
    return Error{file.string() + " says how " + map.filename().string() + " is read: add a line to it, and leave --raster and --drape out"};
  const auto text = readText(file);
  if (!text) return text.error();
  RasterOptions options;
  std::string_view rest = *text;
  for (int line = 1; !rest.empty(); ++line) {
    std::string_view assignment = text::trimmed(text::takePart(rest, '\n'));
    if (assignment.empty() || assignment.front() == '#') continue;
    if (assignment.starts_with("drape=")) {
      options.drape = map.parent_path() / assignment.substr(6);
    } else if (auto added = addRasterOption(assignment, options); !added) {
      return Error{at(file.string(), line) + added.error().message};
    }
  }
  return options;
}

Outcome<std::shared_ptr<const terrain::Terrain>> loadBuiltIn(const terrain::Description& d, const Request& request) {
  if (request.parameters.empty()) return terrain::create(d.name, request.seed);
  const std::string file = std::string(d.name) + ".glsl";
  const auto declaration = readDeclaration(file, d.source);
  if (!declaration) return declaration.error();
  auto text = withParameters(file, d.source, *declaration, request.parameters);
  if (!text) return text.error();
  const auto changed = readDeclaration(file, *text);
  if (!changed) return changed.error();
  auto values = valuesOf(*text, *changed);
  return terrain::create(d.name, request.seed, {std::move(values), std::move(*text)});
}

Outcome<Source> read(const std::filesystem::path& file) {
  auto text = readText(file);
  if (!text) return text.error();
  if (builtIn(file.stem().string())) return Error{problemOf(file, {})};
  return Source{file.stem().string(), file.string(), std::move(*text)};
}

// The fault that probe() found, at the expression it comes from, or at least at terrainHeight.
Error withPlace(const Error& fault, const Source& source, const Request& request, const std::stop_token& stop) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  if (fault.message.find(faultOf(kInfinity - kInfinity)) == std::string::npos &&
      fault.message.find(faultOf(kInfinity)) == std::string::npos)
    return fault;
  const auto checked = checkGlsl(source.file, source.text, stop);
  if (!checked) return fault;
  const auto function = std::ranges::find_if(
      checked->items, [](const TopLevel& item) { return item.what == TopLevel::What::kFunction && item.names[0] == "terrainHeight"; });
  Error atFunction{at(source.file, function->line) + fault.message.substr(source.file.size() + 2)};
  auto translated = translate(source.file, checked->tokens, checked->items);
  const auto scratch = Scratch::create();
  if (!translated || !scratch) return atFunction;
  const std::filesystem::path library = scratch->path() / "traced.so";
  translated->traced = true;
  if (!compile(source.file, *translated, "baseline", library, stop)) return atFunction;
  const auto again = probe(source.file, library, request.seed, request.prober, stop);
  return again || again.error().message == fault.message ? atFunction : again.error();
}

Outcome<std::shared_ptr<const Library>> built(const Source& source, const Request& request, const std::stop_token& stop) {
  const std::string variant = request.variant.empty() ? std::string(terrain::variants().back().name) : request.variant;
  auto cache = Cache::open(request.cache);
  std::optional<Scratch> once;  // without a cache folder, compile every time; a loaded library survives the removal of its file
  if (!cache && request.cache.empty()) {
    auto made = Scratch::create();
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
  if (!file && !request.colours && !stop.stop_requested()) file = make(false);
  if (!file) return file.error();
  if (auto fine = probe(source.file, *file, request.seed, request.prober, stop); !fine)
    return withPlace(fine.error(), source, request, stop);
  return Library::open(*file);
}

}  // namespace

Outcome<std::shared_ptr<const terrain::Terrain>> load(const Request& request, Complain complain, const std::stop_token& stop) {
  const auto file = fileOf(request);
  if (!file) return file.error();
  const bool isMap = !file->empty() && !isGlsl(*file);
  if (request.raster != RasterOptions() && !isMap)
    return Error{"--raster and --drape are for height maps; terrain \"" + request.terrain.substr(0, 64) + "\" takes --param NAME=NUMBER"};
  if (const auto* d = builtIn(request.terrain)) return loadBuiltIn(*d, request);
  if (isMap) {
    if (!request.parameters.empty())
      return Error{"the terrain \"" + request.terrain.substr(0, 64) + "\" is a height map, which has no parameters"};
    const auto options = optionsOf(*file, request.raster);
    if (!options) return options.error();
    return loadRaster(*file, *options, request.seed, {}, stop);
  }
  auto source = read(*file);
  if (!source) return source.error();
  const auto wrong = [&](const Error& error) { return Error{explained(source->file, source->text, error.message)}; };
  if (auto fine = checkText(source->file, source->text); !fine) return wrong(fine.error());
  auto declaration = readDeclaration(source->file, source->text);
  if (!declaration) return wrong(declaration.error());
  auto text = withParameters(source->file, source->text, *declaration, request.parameters);
  if (!text) return text.error();
  source->text = std::move(*text);
  auto library = built(*source, request, stop);
  if (!library) return wrong(library.error());
  if (const std::string better = advice(source->file, source->text); complain && !better.empty()) complain(better);
  return std::shared_ptr<const terrain::Terrain>(
      std::make_shared<Compiled>(std::move(*source), request.seed, std::move(*library), std::move(complain)));
}

std::vector<std::filesystem::path> filesOf(const Request& request) {
  std::vector<std::filesystem::path> files;
  const auto file = fileOf(request);
  if (!file || file->empty()) return files;
  files.push_back(*file);
  if (isGlsl(*file)) return files;
  files.push_back(settingsOf(*file));
  if (const auto options = optionsOf(*file, request.raster); options && !options->drape.empty()) files.push_back(options->drape);
  std::ranges::move(otherFilesOf(*file), std::back_inserter(files));
  return files;
}

Outcome<std::vector<Entry>> list(const std::filesystem::path& folder) {
  std::vector<Entry> out;
  for (const terrain::Description& d : terrain::builtIn()) {
    auto declaration = readDeclaration(std::string(d.name) + ".glsl", d.source);
    out.push_back({std::string(d.name), std::string(d.summary), declaration ? declaration->parameters : std::vector<Parameter>(), {}});
  }
  if (folder.empty()) return out;
  std::error_code failed;
  if (!std::filesystem::is_directory(folder, failed)) return Error{"--terrain-dir: there is no folder " + folder.string()};
  const auto files = filesIn(folder);
  for (const auto& file : files) {
    Entry entry{file.stem().string(), {}, {}, problemOf(file, files)};
    if (!isGlsl(file)) entry.summary = "height map, " + file.filename().string();
    if (!entry.problem.empty() || !isGlsl(file)) {
      out.push_back(std::move(entry));
      continue;
    }
    auto text = readText(file);
    auto fine = text ? checkText(file.string(), *text) : Outcome<void>(text.error());
    auto declaration = fine ? readDeclaration(file.string(), *text) : Outcome<Declaration>(fine.error());
    if (declaration) {
      entry.summary = declaration->summary;
      entry.parameters = declaration->parameters;
    } else {
      entry.problem = declaration.error().message;
    }
    out.push_back(std::move(entry));
  }
  return out;
}

}  // namespace ridgecast::user_terrain
