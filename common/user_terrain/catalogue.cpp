#include "common/user_terrain/catalogue.h"

#include <algorithm>
#include <utility>

#include "common/glsl/check.h"
#include "common/raster/raster_terrain.h"
#include "common/text/file.h"
#include "common/text/text.h"

namespace ridgecast::user_terrain {
namespace {

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
  auto text = text::readFile(file, glsl::kMaxText);
  if (!text) return Error{"cannot read " + file.string()};
  if (text->size() > glsl::kMaxText)
    return Error{file.string() + ": the file has " + std::to_string(std::filesystem::file_size(file, failed)) +
                 " bytes; a terrain file has at most " + std::to_string(glsl::kMaxText)};
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
    if ((isGlsl(entry.path()) || raster::isRasterName(entry.path().string())) && entry.is_regular_file(failed)) out.push_back(entry.path());
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
  if (isGlsl(file) || raster::isRasterName(request.terrain) || (file.has_parent_path() && std::filesystem::exists(file, failed)))
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
Outcome<raster::RasterOptions> optionsOf(const std::filesystem::path& map, const raster::RasterOptions& asked) {
  const std::filesystem::path file = settingsOf(map);
  std::error_code failed;
  if (!std::filesystem::exists(file, failed)) return asked;
  if (asked != raster::RasterOptions())
    return Error{file.string() + " says how " + map.filename().string() +
                 " is read: add a line to it, and leave --raster, --drape and --classes out"};
  const auto text = readText(file);
  if (!text) return text.error();
  raster::RasterOptions options;
  std::string_view rest = *text;
  for (int line = 1; !rest.empty(); ++line) {
    std::string_view assignment = text::trimmed(text::takePart(rest, '\n'));
    if (assignment.empty() || assignment.front() == '#') continue;
    if (assignment.starts_with("drape=")) {
      options.drape = map.parent_path() / assignment.substr(6);
    } else if (assignment.starts_with("classes=")) {
      options.classes = map.parent_path() / assignment.substr(8);
    } else if (auto added = raster::addRasterOption(assignment, options); !added) {
      return Error{glsl::at(file.string(), line) + added.error().message};
    }
  }
  return options;
}

Outcome<std::shared_ptr<const terrain::Terrain>> loadBuiltIn(const terrain::Description& d, const Request& request) {
  if (request.parameters.empty()) return terrain::create(d.name, request.seed);
  const std::string file = std::string(d.name) + ".glsl";
  const auto declaration = glsl::readDeclaration(file, d.source);
  if (!declaration) return declaration.error();
  auto text = glsl::withParameters(file, d.source, *declaration, request.parameters);
  if (!text) return text.error();
  const auto changed = glsl::readDeclaration(file, *text);
  if (!changed) return changed.error();
  auto values = glsl::valuesOf(*text, *changed);
  return terrain::create(d.name, request.seed, {std::move(values), std::move(*text)});
}

Outcome<glsl::Source> read(const std::filesystem::path& file) {
  auto text = readText(file);
  if (!text) return text.error();
  if (builtIn(file.stem().string())) return Error{problemOf(file, {})};
  return glsl::Source{file.stem().string(), file.string(), std::move(*text)};
}

}  // namespace

Outcome<std::shared_ptr<const terrain::Terrain>> load(const Request& request, glsl::Complain complain, const std::stop_token& stop) {
  const auto file = fileOf(request);
  if (!file) return file.error();
  const bool isMap = !file->empty() && !isGlsl(*file);
  if (request.raster != raster::RasterOptions() && !isMap)
    return Error{"--raster, --drape and --classes are for height maps; terrain \"" + request.terrain.substr(0, 64) +
                 "\" takes --param NAME=NUMBER"};
  if (const auto* d = builtIn(request.terrain)) return loadBuiltIn(*d, request);
  if (isMap) {
    if (!request.parameters.empty())
      return Error{"the terrain \"" + request.terrain.substr(0, 64) + "\" is a height map, which has no parameters"};
    const auto options = optionsOf(*file, request.raster);
    if (!options) return options.error();
    return raster::loadRaster(*file, *options, request.seed, {}, stop);
  }
  auto source = read(*file);
  if (!source) return source.error();
  return glsl::load(std::move(*source), request.parameters, request.seed, request.build, std::move(complain), stop);
}

std::vector<std::filesystem::path> filesOf(const Request& request) {
  std::vector<std::filesystem::path> files;
  const auto file = fileOf(request);
  if (!file || file->empty()) return files;
  files.push_back(*file);
  if (isGlsl(*file)) return files;
  files.push_back(settingsOf(*file));
  if (const auto options = optionsOf(*file, request.raster))
    for (const auto& laid : {options->drape, options->classes})
      if (!laid.empty()) files.push_back(laid);
  std::ranges::move(raster::otherFilesOf(*file), std::back_inserter(files));
  return files;
}

Outcome<std::vector<Entry>> list(const std::filesystem::path& folder) {
  std::vector<Entry> out;
  for (const terrain::Description& d : terrain::builtIn()) {
    auto declaration = glsl::readDeclaration(std::string(d.name) + ".glsl", d.source);
    out.push_back(
        {std::string(d.name), std::string(d.summary), declaration ? declaration->parameters : std::vector<glsl::Parameter>(), {}});
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
    auto fine = text ? glsl::checkText(file.string(), *text) : Outcome<void>(text.error());
    auto declaration = fine ? glsl::readDeclaration(file.string(), *text) : Outcome<glsl::Declaration>(fine.error());
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
