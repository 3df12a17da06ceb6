#pragma once
// A log and the history that it keeps, as a server has them.

#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/edits/packed.h"
#include "server/edit_log/log.h"
#include "tests/support/random_edits.h"

namespace ridgecast::edit_log {

inline const std::shared_ptr<const terrain::Terrain>& alpine() {
  static const std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 7).value();
  return terrain;
}
inline World worldOf(const terrain::Terrain& terrain) {
  return {std::string(terrain.name()), terrain.seed(), {}, terrain::contentHash(terrain)};
}

// As a session's first edit does, and those after it.
inline Outcome<std::unique_ptr<Log>> openOrCreate(const std::filesystem::path& file) {
  auto log = Log::open(file);
  return !log || *log ? std::move(log) : Log::create(file, worldOf(*alpine()));
}

inline Applied applied(std::uint64_t number, const std::string& key, const edits::Operation& operation) {
  return {number, key, "", 0, edits::pack(operation), edits::groundOf(edits::areaOf(operation))};
}
inline edits::Operation operationOf(const Applied& edit) { return edits::unpack(edit.operation).value(); }

inline constexpr std::size_t kAll = ~std::size_t{0};

struct Session {
  std::unique_ptr<Log> log;
  edits::History history;

  static Outcome<Session> open(const std::filesystem::path& file) {
    auto log = openOrCreate(file);
    if (!log) return log.error();
    auto history = historyOf(**log, alpine());
    if (!history) return history.error();
    return Session{std::move(*log), std::move(*history)};
  }

  // So many edits in one transaction. Of an error nothing remains, in the history neither.
  template <class F>
  Outcome<std::vector<Applied>> append(std::size_t count, F&& nextOperation) {
    std::vector<Applied> edits;
    std::vector<std::shared_ptr<const edits::Layer>> layers;
    std::vector<edits::Posts> changed;
    int refused = 0;
    while (edits.size() < count) {
      auto prepared = history.prepare(nextOperation());
      if (!prepared && ++refused > 1000) return prepared.error();
      if (!prepared) continue;  // it undoes what cannot be undone
      layers.push_back(history.layer());
      changed.push_back(history.add(*prepared).value());
      const std::uint64_t n = history.last();
      edits.push_back({n, "key " + std::to_string(n), "author " + std::to_string(n % 9),
                       static_cast<std::int64_t>(1'700'000'000'000'000 + n), edits::pack(*prepared), edits::groundOf(changed.back())});
    }
    attempted = edits;
    const auto result = log->append(edits, {*layers.front(), *history.layer(), changed});
    if (result) return edits;
    for (; !layers.empty(); layers.pop_back()) history.takeBack(layers.back());
    return result.error();
  }
  // At one of 64 places, so that an undo repeats few others.
  Outcome<std::vector<Applied>> append(std::size_t count, std::mt19937_64& random) {
    return append(count, [&] {
      if (history.last() > 0 && random() % 8 == 0) return edits::Operation{edits::Undo{1 + random() % history.last()}, 0};
      const auto place = [&] { return static_cast<lattice::Step>(random() % 8) * testing_support::m(240); };
      const lattice::Step x = place();
      return testing_support::randomOperation(random, {x, place()});
    });
  }
  std::vector<Applied> attempted = {};  // by the last append()
};

// What these edits make, one after the other, in a history of its own.
inline std::uint64_t replayedHash(const std::vector<Applied>& edits) {
  edits::History history(alpine());
  for (const Applied& e : edits) (void)history.add(operationOf(e)).value();
  return history.layer()->hash();
}

}  // namespace ridgecast::edit_log
