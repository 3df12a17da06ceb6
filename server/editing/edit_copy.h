#pragma once
// A server's own copy of edits that several servers share: a store that may fall behind. An edit in the shared log is made, whether or not
// this server's disk has room for it: what the disk refuses stays in memory, is read from there, and is stored with the next append that
// succeeds. If the server stops before that, the shared log has it.
//
// Bound: kMaxBehind in memory; then append() fails, and the session cannot go on here.

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "server/edit_store/store.h"

namespace ridgecast::editing {

class EditCopy final : public edit_store::Store {
 public:
  static constexpr std::uint64_t kMaxBehind = 16u << 20;  // as edit_store::Applied::bytes
  using MakeStore = std::function<Outcome<std::unique_ptr<edit_store::Store>>(std::string_view client)>;

  // `store`: null: made by `makeStore` for the first edit, which this client made. `tell`: the operator, of what goes wrong, and when it is
  // right again.
  EditCopy(std::unique_ptr<edit_store::Store> store, MakeStore makeStore,
           std::function<void(const std::string& sentence, bool isGood)> tell)
      : store_(std::move(store)), makeStore_(std::move(makeStore)), tell_(std::move(tell)) {}

  // Makes the store, if there is none. Error: why not.
  Outcome<void> prepare(std::string_view client);

  std::uint64_t last() const override;
  std::uint64_t compacted() const override;
  std::uint64_t bytes() const override;
  Outcome<void> append(std::span<const edit_store::Applied> edits, const edit_store::Change& change) override;
  Outcome<std::vector<edit_store::Applied>> read(std::uint64_t after, std::size_t most) override;
  Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) override;
  // Error: also while it is behind.
  Outcome<std::string> copy(std::size_t most) override;

 private:
  Outcome<void> store(const edit_store::Change& change);  // under the lock, as all below
  Outcome<void> make(std::string_view client);

  mutable std::mutex mutex_;
  std::unique_ptr<edit_store::Store> store_;
  const MakeStore makeStore_;
  const std::function<void(const std::string&, bool)> tell_;
  // Not stored yet, and what that changes.
  std::vector<edit_store::Applied> behind_;
  std::uint64_t bytesBehind_ = 0;
  std::vector<edits::Posts> posts_;
  edits::Layer before_;
};

}  // namespace ridgecast::editing
