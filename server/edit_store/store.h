#pragma once
// Where the edits of a session are kept, in order: without gaps, each once, each as it was made. The edits are authoritative; a store may
// also keep what they have made of the ground.
//
// Once append() has returned, its edits are kept as long as the store promises: a file (edit_log/log.h) survives a power loss, a temporary
// one ends with its program. These rules hold for every implementation (tests/unit/server/edit_log/store_test.cpp).

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/edits/layer.h"
#include "common/edits/operation.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::edit_store {

// For ground that is not known more precisely.
inline constexpr lattice::Area kEverywhere{-2 * lattice::kMaxPosition, -2 * lattice::kMaxPosition, 2 * lattice::kMaxPosition,
                                           2 * lattice::kMaxPosition};

// An edit that was made. It is encoded once: this is what is stored and what members, lists and recordings get.
struct Applied {
  std::uint64_t number = 0;
  std::string key;        // an edit that is sent twice with its key is made once; empty: none
  std::string author;     // edits::toText
  std::int64_t time = 0;  // microseconds since 1970
  std::string operation;  // edits::pack
  lattice::Area ground;   // that it changed, at most
  friend bool operator==(const Applied&, const Applied&) = default;

  // Its size, as pages and budgets count it.
  std::size_t bytes() const { return 64 + key.size() + author.size() + operation.size(); }
};

// What edits have made of the ground: where `after` may differ from `before`.
struct Change {
  const edits::Layer& before;
  const edits::Layer& after;
  std::span<const edits::Posts> posts;
};

// Any thread; one call runs at a time, others wait for it.
class Store {
 public:
  virtual ~Store() = default;
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  virtual std::uint64_t last() const = 0;       // number of the last edit; 0: none
  virtual std::uint64_t compacted() const = 0;  // edits up to this number are permanently part of the ground, and deleted
  virtual std::uint64_t bytes() const = 0;      // of all edits that read() returns

  // Appends these edits, numbered from last() + 1 on, all or none; stored when it returns, which may take as long as a disk does. Error:
  // one sentence, and nothing is stored; their numbers do not follow, or a key exists already.
  virtual Outcome<void> append(std::span<const Applied> edits, const Change& change) = 0;
  // Those numbered above `after`, in order: as many as fit in `most` bytes, at least one; none: no more are left.
  virtual Outcome<std::vector<Applied>> read(std::uint64_t after, std::size_t most) = 0;
  // Of the edit with this key; those of compacted edits are forgotten.
  virtual Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) = 0;
  // Its file, as of last(). Error: one sentence; it is longer than `most` bytes, or there is none.
  virtual Outcome<std::string> copy(std::size_t most) {
    (void)most;
    return Error{"These edits are in no file."};
  }

 protected:
  Store() = default;
};

}  // namespace ridgecast::edit_store
