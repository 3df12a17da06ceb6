#pragma once
// Where the edits of a session are kept, in their order: without gaps, each once, each as it was made. The edits are the truth; a store may
// also keep what they have made of the ground.
//
// What append() has returned for is kept as long as the store promises: a file (edit_log/log.h) survives the loss of power, a temporary one
// ends with its program. The laws hold of every implementation (tests/unit/server/edit_log/store_test.cpp).

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

// Ground that is not known better.
inline constexpr lattice::Area kEverywhere{-2 * lattice::kMaxPosition, -2 * lattice::kMaxPosition, 2 * lattice::kMaxPosition,
                                           2 * lattice::kMaxPosition};

// An edit that was made. It is coded once: this is what is kept, and what members, lists and recordings are told of.
struct Applied {
  std::uint64_t number = 0;
  std::string key;        // an edit that is sent twice with its key is made once; empty: none
  std::string author;     // edits::toText
  std::int64_t time = 0;  // microseconds since 1970
  std::string operation;  // edits::pack
  lattice::Area ground;   // that it changed, at most
  friend bool operator==(const Applied&, const Applied&) = default;

  // What it takes, as pages and prices count it.
  std::size_t bytes() const { return 64 + key.size() + author.size() + operation.size(); }
};

// What edits have made of the ground: where `after` may differ from `before`.
struct Change {
  const edits::Layer& before;
  const edits::Layer& after;
  std::span<const edits::Posts> posts;
};

// Any thread; one call at a time goes on, others wait for it.
class Store {
 public:
  virtual ~Store() = default;
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  virtual std::uint64_t last() const = 0;       // number of the last edit; 0: none
  virtual std::uint64_t compacted() const = 0;  // edits up to this number are a part of the ground for good, and are gone
  virtual std::uint64_t bytes() const = 0;      // of all edits that read() returns

  // These edits, numbered from last() + 1 on, all or none; kept when it returns, which may take as long as a disk does. Error: one
  // sentence, and nothing is kept; they do not follow, or a key is there already.
  virtual Outcome<void> append(std::span<const Applied> edits, const Change& change) = 0;
  // Those numbered above `after`, in order: as many as take `most` bytes, at least one; none: there are no more.
  virtual Outcome<std::vector<Applied>> read(std::uint64_t after, std::size_t most) = 0;
  // Of the edit with this key; those of compacted edits are forgotten.
  virtual Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) = 0;

 protected:
  Store() = default;
};

}  // namespace ridgecast::edit_store
