#pragma once
// A store of edits, and how to make one, in the server's figures: how long edits take to be stored, and whether they can be.

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/edit_store/store.h"
#include "server/metrics/metrics.h"

namespace ridgecast::editing {

// One session's. Counts it in Metrics::editLogsFailing while its last write failed. For one thread at a time.
class StoreHealth {
 public:
  explicit StoreHealth(std::shared_ptr<metrics::Metrics> figures) : figures_(std::move(figures)) {}
  StoreHealth(const StoreHealth&) = delete;
  StoreHealth& operator=(const StoreHealth&) = delete;
  ~StoreHealth() { set(false); }
  void set(bool fails) {
    figures_->editLogsFailing.Increment(static_cast<double>(fails) - static_cast<double>(fails_));
    fails_ = fails;
  }
  metrics::Metrics& figures() const { return *figures_; }

 private:
  const std::shared_ptr<metrics::Metrics> figures_;
  bool fails_ = false;
};

class MeasuredStore final : public edit_store::Store {
 public:
  MeasuredStore(std::unique_ptr<edit_store::Store> store, std::shared_ptr<StoreHealth> health)
      : store_(std::move(store)), health_(std::move(health)) {}

  std::uint64_t last() const override { return store_->last(); }
  std::uint64_t compacted() const override { return store_->compacted(); }
  std::uint64_t bytes() const override { return store_->bytes(); }
  Outcome<void> append(std::span<const edit_store::Applied> edits, const edit_store::Change& change) override {
    const auto begun = std::chrono::steady_clock::now();
    auto appended = store_->append(edits, change);
    health_->figures().editCommit.Observe(std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
    health_->set(!appended);
    return appended;
  }
  Outcome<std::vector<edit_store::Applied>> read(std::uint64_t after, std::size_t most) override { return store_->read(after, most); }
  Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) override { return store_->numberOf(key); }
  Outcome<std::string> copy(std::size_t most) override { return store_->copy(most); }

 private:
  const std::unique_ptr<edit_store::Store> store_;
  const std::shared_ptr<StoreHealth> health_;
};

// Of Edits::Kept.
template <class Kept>
Kept measured(Kept kept, const std::shared_ptr<metrics::Metrics>& figures) {
  const auto health = std::make_shared<StoreHealth>(figures);
  if (kept.store) kept.store = std::make_unique<MeasuredStore>(std::move(kept.store), health);
  if (kept.makeStore)
    kept.makeStore = [make = std::move(kept.makeStore), health](std::string_view client) -> Outcome<std::unique_ptr<edit_store::Store>> {
      auto made = make(client);
      health->set(!made);
      if (!made) return made.error();
      return std::unique_ptr<edit_store::Store>(std::make_unique<MeasuredStore>(std::move(*made), health));
    };
  return kept;
}

}  // namespace ridgecast::editing
