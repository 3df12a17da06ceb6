// The rooms form a ladder: each includes only rooms that its CMake target links, links only those that it includes, and none includes
// itself through others. Those that start threads link Threads::Threads, from which tests know whether the thread sanitizer has something
// to judge.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace ridgecast {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

struct Room {
  std::set<std::string> links, includes;  // names of rooms
  bool linksThreads = false, startsThreads = false;
};

// What ridgecast_room() and target_link_libraries() say, and what the sources include. A folder holds one room.
std::map<std::string, Room> roomsOf(const fs::path& root, std::vector<std::string>& wrong) {
  static const std::regex declaration(R"((ridgecast_room|target_link_libraries)\(\s*(\w+)([^)]*)\))"), word(R"(ridgecast_\w+)"),
      comment("#[^\n]*"), include("(?:^|\n)#include \"([^\"]+)\""), thread(R"(std::(jthread|async|thread(?!::))\b)");
  std::map<std::string, Room> rooms;
  std::map<std::string, std::string> roomOfFolder;
  std::vector<fs::path> sources;
  for (const char* side : {"common", "server", "client"}) {
    if (!fs::exists(root / side)) continue;
    for (auto at = fs::recursive_directory_iterator(root / side); at != fs::recursive_directory_iterator(); ++at) {
      const fs::path& path = at->path();
      if (at->is_directory() && (path.filename() == "node_modules" || path.filename() == "example")) at.disable_recursion_pending();
      if (path.extension() == ".h" || path.extension() == ".cpp") sources.push_back(path);
      if (path.filename() != "CMakeLists.txt") continue;
      const std::string text = std::regex_replace(testing_support::readText(path), comment, "");
      for (std::sregex_iterator call(text.begin(), text.end(), declaration), end; call != end; ++call) {
        const std::string name = (*call)[2], arguments = (*call)[3];
        if ((*call)[1] == "ridgecast_room" && !roomOfFolder.emplace(path.parent_path().string(), name).second)
          wrong.push_back(path.string() + " declares two rooms");
        if ((*call)[1] != "ridgecast_room" && !rooms.contains(name)) continue;  // a program
        for (std::sregex_iterator link(arguments.begin(), arguments.end(), word); link != std::sregex_iterator(); ++link)
          rooms[name].links.insert(link->str());
        if (arguments.find("Threads::Threads") != std::string::npos) rooms[name].linksThreads = true;
        rooms[name];
      }
    }
  }
  const auto roomOf = [&](const fs::path& file) {
    const auto found = roomOfFolder.find(file.parent_path().string());
    return found == roomOfFolder.end() ? std::string() : found->second;
  };
  for (const fs::path& source : sources) {
    const std::string from = roomOf(source), text = testing_support::readText(source);
    if (from.empty()) continue;
    if (std::regex_search(text, thread)) rooms[from].startsThreads = true;
    for (std::sregex_iterator line(text.begin(), text.end(), include), end; line != end; ++line)
      if (const std::string to = roomOf(root / (*line)[1].str()); !to.empty() && to != from) rooms[from].includes.insert(to);
  }
  return rooms;
}

std::vector<std::string> faults(const fs::path& root) {
  std::vector<std::string> wrong;
  const auto rooms = roomsOf(root, wrong);
  for (const auto& [name, room] : rooms) {
    for (const std::string& other : room.includes)
      if (!room.links.contains(other)) wrong.push_back(name + " includes " + other + " and does not link it");
    for (const std::string& other : room.links)
      if (rooms.contains(other) && !room.includes.contains(other)) wrong.push_back(name + " links " + other + " and does not include it");
    if (room.startsThreads && !room.linksThreads) wrong.push_back(name + " starts threads and does not link Threads::Threads");
    if (!room.startsThreads && room.linksThreads) wrong.push_back(name + " links Threads::Threads and starts no thread");
  }
  std::map<std::string, int> state;  // 1: on the way, 2: done
  const std::function<void(const std::string&, std::string)> walk = [&](const std::string& name, std::string way) {
    way += " -> " + name;
    if (state[name] == 1) wrong.push_back("a circle:" + way);
    if (state[name] != 0) return;
    state[name] = 1;
    for (const std::string& other : rooms.at(name).includes) walk(other, way);
    state[name] = 2;
  };
  for (const auto& [name, room] : rooms) walk(name, "");
  return wrong;
}

void plant(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

// client/core alone reads what a server says, and it has no socket, thread, clock or picture. Lines that break it.
std::vector<std::string> breachesOfTheCore(const fs::path& root) {
  static const std::regex reads(R"(\bdecodeServer\(|@bufbuild/protobuf|generated/ridgecast)"),
      touches(R"(std::(jthread|async|thread|mutex)\b|::now\(\)|<boost/(asio|beast)|epoxy|GLFW|common/transport)");
  std::vector<std::string> wrong;
  for (auto at = fs::recursive_directory_iterator(root / "client"); at != fs::recursive_directory_iterator(); ++at) {
    const fs::path& path = at->path();
    const std::string name = path.filename().string(), place = fs::relative(path, root).string();
    if (at->is_directory() && (name == "node_modules" || name == "generated" || name == "dist")) at.disable_recursion_pending();
    if (path.extension() != ".h" && path.extension() != ".cpp" && path.extension() != ".ts") continue;
    if (std::regex_search(testing_support::readText(path), place.starts_with("client/core/") ? touches : reads)) wrong.push_back(place);
  }
  return wrong;
}

TEST(Rooms, TheCoreOfTheClientAloneReadsWhatAServerSays) {
  EXPECT_THAT(breachesOfTheCore(RIDGECAST_SOURCE), IsEmpty());
  const testing_support::ScratchFolder root;
  const auto write = [&](const std::string& file, const std::string& text) { plant(root / file, text); };
  write("client/core/mesh/good.cpp", "wire::decodeServer(frame);\n");
  write("client/web/src/good.ts", "import { Core } from './core/core';\n");
  write("client/core/mesh/bad.cpp", "const auto now = Clock::now();\n");
  write("client/viewer/bad.cpp", "wire::decodeServer(frame);\n");
  write("client/web/src/bad.ts", "import { fromBinary } from '@bufbuild/protobuf';\n");
  EXPECT_THAT(breachesOfTheCore(root / ""),
              testing::UnorderedElementsAre("client/core/mesh/bad.cpp", "client/viewer/bad.cpp", "client/web/src/bad.ts"));
}

// Which rooms CONTRIBUTING names in its tables, and which there are.
std::multiset<std::string> listedRooms(const std::string& document) {
  static const std::regex table(R"(\n\| `(common|server|client)` \|[^\n]*\n\|---\|---\|\n((?:\|[^\n]*\n)+))"),
      row(R"((?:^|\n)\| `([\w/]+)` \|)");
  std::multiset<std::string> rooms;
  for (std::sregex_iterator side(document.begin(), document.end(), table), end; side != end; ++side) {
    const std::string rows = (*side)[2];
    for (std::sregex_iterator line(rows.begin(), rows.end(), row); line != end; ++line)
      rooms.insert((*side)[1].str() + "/" + (*line)[1].str());
  }
  return rooms;
}

TEST(Rooms, AreListedWithTheirQuestions) {
  const fs::path root = RIDGECAST_SOURCE;
  std::multiset<std::string> there;
  for (const char* side : {"common", "server", "client"})
    for (const auto& entry : fs::recursive_directory_iterator(root / side))
      if (entry.path().filename() == "CMakeLists.txt" &&
          testing_support::readText(entry.path()).find("ridgecast_room(") != std::string::npos)
        there.insert(fs::relative(entry.path().parent_path(), root).string());
  EXPECT_EQ(listedRooms(testing_support::readText(root / "CONTRIBUTING.md")), there);
}

TEST(Rooms, FormALadder) { EXPECT_THAT(faults(RIDGECAST_SOURCE), IsEmpty()); }

TEST(Rooms, APlantedFaultIsFound) {
  const testing_support::ScratchFolder scratch;
  const fs::path root = scratch / "";
  const auto write = [&](const std::string& file, const std::string& text) { plant(root / file, text); };
  write("common/low/CMakeLists.txt", "ridgecast_room(ridgecast_low)\n");
  write("common/low/low.h", "#pragma once\n");
  write("server/high/CMakeLists.txt", "ridgecast_room(ridgecast_high SOURCES high.cpp LINKS ridgecast_low)\n");
  write("server/high/high.cpp", "#include \"common/low/low.h\"\n");
  EXPECT_THAT(faults(root), IsEmpty());
  write("server/high/CMakeLists.txt", "ridgecast_room(ridgecast_high SOURCES high.cpp)\n");
  EXPECT_THAT(faults(root), ElementsAre(HasSubstr("includes ridgecast_low and does not link it")));
  write("server/high/CMakeLists.txt", "ridgecast_room(ridgecast_high SOURCES high.cpp LINKS ridgecast_low)\n");
  write("server/high/high.h", "#pragma once\n");
  write("common/low/CMakeLists.txt", "ridgecast_room(ridgecast_low LINKS ridgecast_high)\n");
  EXPECT_THAT(faults(root), ElementsAre(HasSubstr("links ridgecast_high and does not include it")));
  write("common/low/low.h", "#pragma once\n#include \"server/high/high.h\"\n");
  EXPECT_THAT(faults(root), ElementsAre(HasSubstr("a circle")));
  write("common/low/CMakeLists.txt", "ridgecast_room(ridgecast_low)\n");
  write("common/low/low.h", "#pragma once\ninline std::jthread idle() { return {}; }\n");
  EXPECT_THAT(faults(root), ElementsAre(HasSubstr("starts threads")));
  write("common/low/CMakeLists.txt", "ridgecast_room(ridgecast_low LINKS Threads::Threads)\n");
  EXPECT_THAT(faults(root), IsEmpty());
  write("common/low/low.h", "#pragma once\ninline std::thread::id idle() { return {}; }\n");
  EXPECT_THAT(faults(root), ElementsAre(HasSubstr("starts no thread")));
}

}  // namespace
}  // namespace ridgecast
