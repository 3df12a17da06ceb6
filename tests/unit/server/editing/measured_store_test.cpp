#include "server/editing/measured_store.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/editing/edits.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::editing {
namespace {

// Fails as its owner says; otherwise keeps nothing.
class Moody final : public edit_store::Store {
 public:
  explicit Moody(const bool& fails) : fails_(fails) {}
  std::uint64_t last() const override { return 0; }
  std::uint64_t compacted() const override { return 0; }
  std::uint64_t bytes() const override { return 0; }
  Outcome<void> append(std::span<const Applied>, const edit_store::Change&) override {
    if (fails_) return Error{"The disk is full."};
    return {};
  }
  Outcome<std::vector<Applied>> read(std::uint64_t, std::size_t) override { return std::vector<Applied>(); }
  Outcome<std::optional<std::uint64_t>> numberOf(const std::string&) override { return std::optional<std::uint64_t>(); }

 private:
  const bool& fails_;
};

TEST(MeasuredStore, CountsWritesAndWhereTheyFail) {
  const auto figures = std::make_shared<metrics::Metrics>();
  const auto commits = [&] { return figures->editCommit.Collect().histogram.sample_count; };
  bool cannotBegin = true, fails = false;
  Edits::Kept kept;
  kept.makeStore = [&](std::string_view) -> Outcome<std::unique_ptr<edit_store::Store>> {
    if (cannotBegin) return Error{"There is no room for another log."};
    return std::unique_ptr<edit_store::Store>(std::make_unique<Moody>(fails));
  };
  kept = measured(std::move(kept), figures);
  EXPECT_EQ(figures->editLogsFailing.Value(), 0);
  EXPECT_FALSE(kept.makeStore("ann"));
  EXPECT_FALSE(kept.makeStore("ann"));
  EXPECT_EQ(figures->editLogsFailing.Value(), 1) << "one session's";
  cannotBegin = false;
  auto store = kept.makeStore("ann").value();
  EXPECT_EQ(figures->editLogsFailing.Value(), 0);
  const auto append = [&] {
    const edits::Layer layer;
    return store->append({}, {layer, layer, {}});
  };
  EXPECT_TRUE(append());
  EXPECT_EQ(commits(), 1u);
  fails = true;
  EXPECT_EQ(append().error().message, "The disk is full.");
  EXPECT_FALSE(append());
  EXPECT_EQ(figures->editLogsFailing.Value(), 1);
  EXPECT_EQ(commits(), 3u);
  kept = {};
  store.reset();
  EXPECT_EQ(figures->editLogsFailing.Value(), 0) << "its session has ended";
}

}  // namespace
}  // namespace ridgecast::editing
