#include "server/edits_command.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <ranges>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/edits/author.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/text/text.h"
#include "common/user_terrain/catalogue.h"
#include "server/config/config.h"
#include "server/edit_log/lock.h"
#include "server/edit_log/log.h"
#include "server/edit_store/store.h"

namespace ridgecast {
namespace {

using edit_log::Log;
using edit_store::Applied;
using Json = nlohmann::ordered_json;

constexpr std::size_t kAtATime = 1024, kBytesAtATime = 1u << 20;  // edits and bytes of edits
constexpr const char* kUsage =
    "Say list, export, import, compact, verify, backup or forget, then the log's file: ridgecast-server edits list session.edits; see "
    "--help.";
constexpr const char* kHelp = R"(Usage: ridgecast-server edits COMMAND FILE

Manages the log of a session's edits, FOLDER/SESSION.edits of --state FOLDER, while no server has its session.

  list FILE                      Print a table of the edits
  export FILE                    Write them to standard output, one JSON object a line: number, key, author, name, time (microseconds
                                 since 1970) and edit
  import FILE [FROM] [SETTINGS]  Make a new log from such lines, read from FROM or standard input; only "edit" is required
  compact FILE [SETTINGS]        Make what they changed part of the ground; they can no longer be undone
  verify FILE [SETTINGS]         Make the ground again from the edits and compare it with the cached tiles
  backup FILE TO                 Copy the log; while a server has its session: curl -o TO http://HOST:PORT/v1/sessions/SESSION/backup
  forget FILE                    Remove the log: the session's name is free for another world

SETTINGS are those of ridgecast-server that name the terrain, such as --terrain dem.tif. compact and verify need them only if the log's
name of the terrain does not suffice.
Exit status: 0; 1 after a failure; 2 after bad input.
)";

constexpr const char* kAskServer = " Or ask that server for the copy: GET /v1/sessions/SESSION/backup.";

int refuse(int status, const std::string& sentence) {
  std::cerr << "ridgecast-server edits: " << sentence << "\n";
  return status;
}

// The settings' terrain if they name one, otherwise the log's; with the log's seed and parameters.
Outcome<std::shared_ptr<const terrain::Terrain>> terrainOf(const edit_log::World& world, user_terrain::Request request) {
  if (request.terrain == user_terrain::Request().terrain) request.terrain = world.terrain;
  request.seed = world.seed;
  request.parameters = world.parameters;
  return user_terrain::load(request, [](const std::string& complaint) { std::cerr << complaint << "\n"; });
}

// Calls f with every edit in order, and its operation.
template <class F>
Outcome<void> forEach(Log& log, F&& f) {
  for (std::uint64_t after = log.compacted(); after < log.last();) {
    const auto edits = log.read(after, kBytesAtATime);
    if (!edits) return edits.error();
    for (const Applied& e : *edits) {
      const auto operation = edits::unpack(e.operation);
      if (!operation) return Error{"Edit " + std::to_string(e.number) + " cannot be read: " + operation.error().message};
      f(e, *operation);
    }
    if (edits->empty()) break;
    after = edits->back().number;
  }
  return {};
}

std::string timeOf(std::int64_t microseconds) {
  const auto seconds = static_cast<std::time_t>(microseconds / 1'000'000);
  std::tm parts{};
  char text[32] = "?";
  if (gmtime_r(&seconds, &parts)) std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S", &parts);
  return text;
}

// "crater depth 2 radius 5 x 0 z 0"; of lists only how long they are.
std::string summaryOf(const edits::Operation& operation) {
  const Json json = Json::parse(edits::toJson(operation));
  std::string out = json["op"];
  for (const auto& [name, value] : json.items())
    if (name != "op")
      out += " " + name + " " +
             (value.is_array()    ? "of " + std::to_string(value.size())
              : value.is_string() ? value.get<std::string>()
                                  : value.dump());
  return out;
}

// Edits that do not count: an undo counts unless a later one, that counts, undoes it.
Outcome<std::set<std::uint64_t>> undoneOf(Log& log) {
  std::vector<std::pair<std::uint64_t, std::uint64_t>> undos;  // its number, and whose
  const auto read = forEach(log, [&](const Applied& e, const edits::Operation& operation) {
    if (const auto* const undo = std::get_if<edits::Undo>(&operation.what)) undos.emplace_back(e.number, undo->edit);
  });
  if (!read) return read.error();
  std::set<std::uint64_t> undone;
  for (auto [number, edit] : std::views::reverse(undos))
    if (!undone.contains(number)) undone.insert(edit);
  return undone;
}

int list(Log& log) {
  const auto undone = undoneOf(log);
  if (!undone) return refuse(1, undone.error().message);
  if (log.compacted() > 0) std::printf("Edits 1 to %llu were compacted.\n", static_cast<unsigned long long>(log.compacted()));
  std::printf("%8s  %-19s  %-16s  %s\n", "number", "time (UTC)", "author", "edit");
  const auto printed = forEach(log, [&](const Applied& e, const edits::Operation& operation) {
    std::string author = e.author;
    if (const auto end = author.find('\n'); end != author.npos) author = author.substr(0, end) + " (" + author.substr(end + 1) + ")";
    std::ranges::replace_if(
        author, [](unsigned char c) { return c < 32 || c == 127; }, '?');
    std::printf("%8llu  %-19s  %-16s  %s%s\n", static_cast<unsigned long long>(e.number), timeOf(e.time).c_str(), author.c_str(),
                summaryOf(operation).c_str(), undone->contains(e.number) ? " (undone)" : "");
  });
  return printed ? 0 : refuse(1, printed.error().message);
}

int writeOut(Log& log) {
  if (log.compacted() > 0) std::cerr << "Edits 1 to " << log.compacted() << " were compacted: these lines do not make the ground alone.\n";
  const auto written = forEach(log, [](const Applied& e, const edits::Operation& operation) {
    const edits::Author author = edits::authorOf(e.author);
    const Json line{{"number", e.number},  {"key", e.key},   {"author", author.client},
                    {"name", author.name}, {"time", e.time}, {"edit", Json::parse(edits::toJson(operation))}};
    std::cout << line.dump(-1, ' ', false, Json::error_handler_t::replace) << "\n";
  });
  if (!written) return refuse(1, written.error().message);
  return std::cout.flush() ? 0 : refuse(1, "Cannot write to standard output.");
}

// A line of export, as the edit that follows `last`, before it is made.
struct Line {
  Applied edit;
  edits::Operation operation;
};
Outcome<Line> parseLine(const std::string& text, std::uint64_t last) {
  const Json json = Json::parse(text, nullptr, false);
  if (!json.is_object() || !json.contains("edit")) return Error{R"(it is not a JSON object with an "edit")"};
  Line line{{last + 1, "", "", 0, "", {}}, {}};
  Applied& out = line.edit;
  for (const auto& [name, value] : json.items()) {
    const bool isText = name == "key" || name == "author" || name == "name", isNumber = name == "number" || name == "time";
    if (!(isText && value.is_string()) && !(isNumber && value.is_number_integer()) && name != "edit")
      return Error{"\"" + name.substr(0, 64) + "\" is not one of number, key, author, name, time and edit, or has another type"};
    if ((name == "author" || name == "name") && !edits::isFitForAuthor(value.get<std::string>()))
      return Error{"its \"" + name + "\" is one that no client accepts: at most " + std::to_string(edits::kMaxAuthorBytes) +
                   " bytes, no control characters"};
  }
  out.key = json.value("key", "");
  out.author = edits::toText({json.value("author", ""), json.value("name", "")});
  out.time = json.value(
      "time",
      std::int64_t{std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count()});
  if (const auto number = json.value("number", out.number); number != out.number)
    return Error{"its number is " + std::to_string(number) + ", but " + std::to_string(out.number) + " is next"};
  auto operation = edits::fromJson(json["edit"].dump());
  if (!operation) return operation.error();
  line.operation = std::move(*operation);
  return line;
}

Outcome<void> addLines(std::istream& in, Log& log, edits::History& history) {
  std::size_t lineNumber = 0;
  for (bool isOver = false; !isOver;) {
    const std::shared_ptr<const edits::Layer> before = history.layer();
    std::vector<Applied> edits;
    std::vector<edits::Posts> changed;
    while (edits.size() < kAtATime && !isOver) {
      std::string line;
      isOver = !std::getline(in, line);
      ++lineNumber;
      if (isOver || line.find_first_not_of(" \r") == line.npos) continue;
      const auto where = [&](const Error& e) { return Error{"Line " + std::to_string(lineNumber) + ": " + e.message}; };
      auto parsed = parseLine(line, history.last());
      if (!parsed) return where(parsed.error());
      auto prepared = history.prepare(std::move(parsed->operation));
      if (!prepared) return where(prepared.error());
      Applied& edit = edits.emplace_back(std::move(parsed->edit));
      edit.operation = edits::pack(*prepared);
      const auto posts = history.add(std::move(*prepared));
      if (!posts) return where(posts.error());
      edit.ground = edits::groundOf(*posts);
      changed.push_back(*posts);
    }
    if (auto kept = log.append(edits, {*before, *history.layer(), changed}); !kept) return kept.error();
  }
  return {};
}

int import(const std::filesystem::path& file, std::istream& in, const user_terrain::Request& request) {
  auto lock = edit_log::Lock::take(file);
  if (!lock) return refuse(1, lock.error().message);
  if (std::filesystem::exists(file)) return refuse(2, "'" + file.string() + "' exists already; name a new file.");
  auto terrain = user_terrain::load(request, [](const std::string& complaint) { std::cerr << complaint << "\n"; });
  if (!terrain) return refuse(2, terrain.error().message);
  edit_log::World world{std::string((*terrain)->name()), request.seed, request.parameters, terrain::contentHash(**terrain)};
  std::ranges::sort(world.parameters);
  auto log = Log::create(*lock, world);
  if (!log) return refuse(1, log.error().message);
  edits::History history(*terrain);
  if (auto added = addLines(in, **log, history); !added) {
    log->reset();
    std::error_code ignored;
    std::filesystem::remove(file, ignored);
    return refuse(1, added.error().message);
  }
  std::cout << file.string() << ": " << history.last() << " edits, " << history.layer()->tiles() << " tiles\n";
  return 0;
}

int compact(Log& log, const user_terrain::Request& request) {
  auto terrain = terrainOf(log.world(), request);
  if (!terrain) return refuse(2, terrain.error().message);
  // Also makes tiles anew that are no good.
  if (auto history = edit_log::historyOf(log, *terrain); !history) return refuse(1, history.error().message);
  if (auto compacted = log.compact(); !compacted) return refuse(1, compacted.error().message);
  std::cout << "Edits 1 to " << log.last() << " are a part of the ground now and cannot be undone; the next is edit " << log.last() + 1
            << ".\n";
  return 0;
}

// Those that differ, and one of them.
std::pair<std::size_t, edits::TileAddress> compare(const edits::Layer& a, const edits::Layer& b) {
  std::pair<std::size_t, edits::TileAddress> out;
  std::vector<edits::TileAddress> all = a.addresses();
  std::ranges::copy(b.addresses(), std::back_inserter(all));
  std::ranges::sort(all);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  const edits::Tile none;
  for (const edits::TileAddress at : all) {
    const edits::Tile *const x = a.tile(at), *const y = b.tile(at);
    if ((x ? *x : none) != (y ? *y : none) && out.first++ == 0) out.second = at;
  }
  return out;
}

int verify(Log& log, const user_terrain::Request& request) {
  if (auto sound = log.check(); !sound) return refuse(1, sound.error().message);
  auto terrain = terrainOf(log.world(), request);
  if (!terrain) return refuse(2, terrain.error().message);
  if (auto same = edit_log::checkTerrain(log, **terrain); !same) return refuse(1, same.error().message);
  edits::History history(*terrain);
  history.restore(log.compacted(), log.last(), nullptr, [&](std::uint64_t after) { return log.past(after, log.last()); });
  if (auto replayed = history.replay(); !replayed) return refuse(1, replayed.error().message);
  const auto cached = log.layer();
  if (!cached)
    return refuse(1, cached.error().message + " The edits themselves are sound: the server makes the tiles again when it opens the log.");
  if (const auto [count, at] = compare(*history.layer(), **cached); count > 0)
    return refuse(1, std::to_string(count) + " cached tiles differ from what the edits make, for instance the one from " +
                         std::to_string(at.posts().x0 / 2) + ", " + std::to_string(at.posts().z0 / 2) + " m on.");
  std::cout << log.last() - log.compacted() << " edits after " << log.compacted() << " compacted ones, " << (*cached)->tiles()
            << " tiles, hash " << text::hexadecimal((*cached)->hash()) << ": sound\n";
  return 0;
}

// One that cannot be read, too.
int forget(const std::filesystem::path& file) {
  const auto lock = edit_log::Lock::take(file);
  if (!lock) return refuse(1, lock.error().message);
  std::error_code failed;
  for (const char* const ending : {"", "-wal", "-shm"})  // a journal without its file counts for nothing
    if (std::filesystem::remove(file.string() + ending, failed); failed)
      return refuse(1, "Cannot remove '" + file.string() + ending + "': " + failed.message() + ".");
  return 0;
}

}  // namespace

int runEditsCommand(int argc, const char* const* argv, const char* const* environment) {
  const std::string_view what = argc > 1 ? argv[1] : "";
  if (std::any_of(argv, argv + argc, [](std::string_view a) { return a == "--help" || a == "-h"; }))
    return std::cout << kHelp << std::flush ? 0 : 1;
  if (argc < 3 || std::string_view(argv[2]).starts_with("--")) return refuse(2, kUsage);
  const std::filesystem::path file = argv[2];
  const bool hasOther = argc > 3 && !std::string_view(argv[3]).starts_with("--");
  const std::string other = hasOther ? argv[3] : "";
  std::vector<const char*> settings{argv[0]};
  settings.insert(settings.end(), argv + (hasOther ? 4 : 3), argv + argc);
  const config::Parsed parsed = config::parse(static_cast<int>(settings.size()), settings.data(), environment);
  if (!parsed.config) return parsed.status;
  const user_terrain::Request& request = parsed.config->terrain;

  if (what == "import") {
    std::ifstream lines(other);
    if (hasOther && !lines) return refuse(2, "Cannot read '" + other + "'.");
    return import(file, hasOther ? lines : std::cin, request);
  }
  std::error_code failed;
  if (!std::filesystem::exists(file, failed)) return refuse(2, "There is no file '" + file.string() + "'.");
  if (what == "forget") return forget(file);
  auto log = Log::open(file);
  if (!log) return refuse(1, log.error().message + (what == "backup" && edit_log::Lock::isTaken(file) ? kAskServer : ""));
  if (!*log) return refuse(1, "'" + file.string() + "' is empty: its first edit was cut off.");
  if (what == "list") return list(**log);
  if (what == "export") return writeOut(**log);
  if (what == "compact") return compact(**log, request);
  if (what == "verify") return verify(**log, request);
  if (what != "backup" || !hasOther) return refuse(2, what == "backup" ? "Say where to: ridgecast-server edits backup FILE TO." : kUsage);
  const auto made = (*log)->backUp(other);
  return made ? 0 : refuse(1, made.error().message);
}

}  // namespace ridgecast
