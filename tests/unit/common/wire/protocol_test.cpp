// PROTOCOL.md states the ranges by which messages are judged: no other, and all of them.
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <regex>
#include <sstream>

#include "common/wire/tables.h"

namespace ridgecast::wire {
namespace {

// The tables of PROTOCOL.md: "Message.field", and "Message" for its size -> its range in words; empty: anything.
using Ranges = std::map<std::string, std::string>;

template <class T, class V>
void describe(Ranges& out);

template <class T>
void note(const auto& row, Ranges& out) {
  std::string& range = out[std::string(kTable<T>.message) + "." + row.name];
  const std::string words = row.rule.words();
  if (range.find(words) == std::string::npos) range += (range.empty() ? "" : "; ") + words;
}
template <class T, class V>
void describeRow(const NoField&, Ranges&) {}
template <class T, class V, class Rule>
void describeRow(const Judged<Rule>& row, Ranges& out) {
  note<T>(row, out);
}
template <class T, class V, class Sent, class Base>
void describeRow(const SentAs<Sent, Base>& row, Ranges& out) {
  note<T>(row, out);
  describe<typename TableOf<Sent>::type, Sent>(out);
}
template <class T, class V, class... Part>
void describeRow(const Row<Part...>& row, Ranges& out) {
  using M = typename Row<Part...>::template MemberOf<V>;
  note<T>(row, out);
  if constexpr (Messages<M> || Maybe<M>::value) {
    describe<typename Row<Part...>::template InnerOf<M>::type, typename M::value_type>(out);
  } else if constexpr (Message<M>) {
    describe<typename Row<Part...>::template InnerOf<M>::type, M>(out);
  }
}
template <class T, class V>
void describe(Ranges& out) {
  everyRow<T>([&](const auto& row, std::size_t) { return describeRow<T, V>(row, out), true; });
}

Ranges ranges() {
  Ranges out{{"ClientMessage", Bytes{kMaxClientMessageBytes}.words()}, {"ServerMessage", Bytes{kMaxServerMessageBytes}.words()}};
  describe<ClientMessageTable, ClientMessage>(out);
  describe<ServerMessageTable, ServerMessage>(out);
  return out;
}

std::vector<std::string> cellsOf(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line.substr(1));
  for (std::string cell; std::getline(in, cell, '|');) cells.push_back(std::regex_replace(cell, std::regex("^ +| +$"), ""));
  return cells;
}

// Every field of a table that begins with `| field | range` (or `| message | range`). Fields without a dot are those of the heading.
Ranges documented() {
  Ranges out;
  std::ifstream in(RIDGECAST_PROTOCOL);
  std::string heading;
  bool states = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("### ")) heading = line.substr(4);
    if (!line.starts_with("|")) {
      states = false;
      continue;
    }
    const auto cells = cellsOf(line);
    if (cells.size() < 2) continue;
    const bool begins = cells[1] == "range";
    if (states && !cells[0].starts_with("-")) {
      const std::string range = std::regex_replace(cells[1], std::regex(R"(\[([^\]]*)\]\([^)]*\)|`)"), "$1");
      static const std::regex field("`([A-Za-z0-9_.]+)`");
      for (auto it = std::sregex_iterator(cells[0].begin(), cells[0].end(), field); it != std::sregex_iterator(); ++it) {
        const std::string name = (*it)[1];
        const bool whole = name.find('.') != std::string::npos || std::isupper(static_cast<unsigned char>(name.front()));
        const std::string key = whole ? name : heading + "." + name;
        EXPECT_TRUE(out.emplace(key, range).second) << key << " is stated twice";
      }
    }
    states = states || begins;
  }
  return out;
}

TEST(Protocol, StatesTheRangesThatAreKept) {
  const Ranges kept = ranges(), stated = documented();
  for (const auto& [field, range] : kept) {
    const auto found = stated.find(field);
    if (range.empty() && found == stated.end()) continue;
    EXPECT_EQ(found == stated.end() ? "nothing" : found->second, range) << "PROTOCOL.md on " << field;
  }
  for (const auto& [field, range] : stated) EXPECT_TRUE(kept.contains(field)) << "PROTOCOL.md knows a " << field;
  EXPECT_GT(stated.size(), 100u);
}

TEST(Protocol, StatesTheLimitsOfTheConversation) {
  std::ifstream in(RIDGECAST_PROTOCOL);
  const std::string text((std::istreambuf_iterator<char>(in)), {});
  const auto states = [&](const std::string& sentence) { EXPECT_NE(text.find(sentence), std::string::npos) << sentence; };
  states("at most 65,536 in all");
  EXPECT_EQ(kMaxResumed, 65'536u);
  states("at most " + std::to_string(kMaxWantedTiles) + " that are not answered yet");
  states("At most " + std::to_string(kMaxQueries) + " queries may be open");
  states("At most " + std::to_string(kMaxGrounds) + " may be open");
}

}  // namespace
}  // namespace ridgecast::wire
