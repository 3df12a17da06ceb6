// Entries against a vector of strings, whatever is added and removed.
#include "common/edits/entries.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <utility>
#include <vector>

namespace ridgecast::edits {
namespace {

TEST(Entries, AreWhatWasAddedAndNotRemoved) {
  std::mt19937 random(3);
  for (const unsigned removed : {10u, 45u, 55u}) {  // of a hundred
    Entries entries;
    std::vector<std::pair<std::string, std::uint32_t>> truth;
    for (int step = 0; step < 3000; ++step) {
      if (!truth.empty() && random() % 100 < removed) {
        entries.removeLast();
        truth.pop_back();
      } else {
        truth.emplace_back(std::string(random() % 40, static_cast<char>(random())), random() % 3);
        entries.add(truth.back().first, truth.back().second);
      }
      if (!truth.empty()) truth[truth.size() / 2].second = ++entries.undos(truth.size() / 2);
      ASSERT_EQ(entries.size(), truth.size());
      if (step % 50 != 0) continue;
      for (std::size_t k = 0; k < truth.size(); ++k) {
        ASSERT_EQ(entries.packed(k), truth[k].first) << k;
        ASSERT_EQ(std::as_const(entries).undos(k), truth[k].second) << k;
      }
    }
  }
}

}  // namespace
}  // namespace ridgecast::edits
