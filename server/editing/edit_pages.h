#pragma once
// The edits that members are told of: pages of the history, each encoded once for all members at the same edit. A page is made on request
// and lives while a queue holds it, so that a million unread edits take nothing.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/editing/edits.h"
#include "server/scheduling/pool.h"

namespace ridgecast::editing {

// Any thread.
class EditPages : public std::enable_shared_from_this<EditPages> {
 public:
  // Of the edits as they are kept, and of their text, or a single edit.
  static constexpr std::size_t kMaxKeptBytes = 64u << 10, kMaxBytes = 256u << 10;

  EditPages(std::shared_ptr<Edits> edits, scheduling::Executor& executor) : edits_(std::move(edits)), pool_(executor.makePool(1)) {}

  struct Page {
    std::shared_ptr<const std::string> message;  // wire::encode of an Edited; null: there are no more
    std::uint64_t last = 0;                      // its last edit
  };
  using Take = std::function<void(const Outcome<Page>& page)>;
  // The edits that follow `after`. `take` is called by a task; callers bound the number of calls.
  void page(std::uint64_t after, Take take);

 private:
  struct Read {
    std::uint64_t after = 0;
    std::optional<Page> page;  // coded before
    Outcome<std::vector<Applied>> edits;
  };
  void answer(Read read);  // by a task; under the lock
  void code();

  const std::shared_ptr<Edits> edits_;
  const std::shared_ptr<scheduling::Pool> pool_;
  std::mutex mutex_;
  std::map<std::uint64_t, std::vector<Take>> asked_;  // by `after`
  std::deque<Read> read_;
  struct Coded {
    std::uint64_t after = 0, last = 0;
    std::weak_ptr<const std::string> message;
  };
  static constexpr std::size_t kRecent = 8;
  std::deque<Coded> coded_;  // the newest
};

}  // namespace ridgecast::editing
