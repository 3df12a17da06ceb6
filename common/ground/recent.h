#pragma once
// Internal to the room: values by key that threads make and share, the least recently used forgotten. Two generations: what is found in the
// older one moves to the younger; when that is full it becomes the older one, and what nobody asked for since is gone.

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "common/lattice/lattice.h"

namespace ridgecast::ground {

// A square of a level, counted from the lattice's origin.
struct Square {
  std::int64_t i = 0, j = 0;
  int level = -1;
  friend bool operator==(const Square&, const Square&) = default;
};

template <class Value>
class Recent {
  class Generation;

 public:
  // At most 2 x `most` values; an eighth of that while all Recents of a process together have more than 4 x `most`.
  explicit Recent(std::size_t most) : most_(most), younger_(std::make_shared<Generation>(few(), most)) {}

  // Finds and makes values, which live as long as this. One thread at a time; any number of them.
  class Reader {
   public:
    explicit Reader(Recent& all) : all_(all) { refresh(); }

    // `make` is called where the value is not kept: the same for the same square, whoever makes it.
    template <class Make>
    const Value& at(const Square& square, const Make& make) {
      if (younger_->isFull()) refresh();
      if (const Value* const found = younger_->find(square)) return *found;
      if (const Value* const found = older_ ? older_->find(square) : nullptr) return younger_->add(square, *found);
      return younger_->add(square, make());
    }

   private:
    void refresh() {
      if (younger_) held_.push_back(younger_);
      std::tie(younger_, older_) = all_.generations();
      held_.push_back(older_);
    }
    Recent& all_;
    std::shared_ptr<Generation> younger_, older_;
    std::vector<std::shared_ptr<Generation>> held_;
  };

 private:
  // A hash table that only grows: slots are taken once, by whoever comes first.
  class Generation {
    struct Entry {
      Square square;
      Value value;
    };

   public:
    // `most` of this one; of one that is alone, `alone`.
    Generation(std::size_t most, std::size_t alone) : most_(most), alone_(alone) {
      std::size_t slots = 64;
      while (slots < 2 * most) slots *= 2;
      slots_ = std::vector<std::atomic<Entry*>>(slots);
    }
    Generation(const Generation&) = delete;
    ~Generation() {
      for (auto& slot : slots_) delete slot.load(std::memory_order_relaxed);
      inAll_ -= count_;
    }
    // Others may add while this is looked at: somewhat before the table would be.
    bool isFull() const {
      const std::size_t count = count_.load(std::memory_order_relaxed);
      return count >= most_ || (count >= alone_ / 16 && areMany(alone_));
    }

    const Value* find(const Square& square) const {
      for (std::size_t k = hash(square);; ++k) {
        const Entry* const entry = slots_[k & (slots_.size() - 1)].load(std::memory_order_acquire);
        if (!entry) return nullptr;
        if (entry->square == square) return &entry->value;
      }
    }
    const Value& add(const Square& square, const Value& value) {
      auto made = std::make_unique<Entry>(Entry{square, value});
      for (std::size_t k = hash(square);; ++k) {
        std::atomic<Entry*>& slot = slots_[k & (slots_.size() - 1)];
        Entry* there = nullptr;
        if (slot.compare_exchange_strong(there, made.get(), std::memory_order_acq_rel)) {
          count_.fetch_add(1, std::memory_order_relaxed);
          inAll_.fetch_add(1, std::memory_order_relaxed);
          return made.release()->value;
        }
        if (there->square == square) return there->value;  // another thread was first
      }
    }

   private:
    static std::size_t hash(const Square& s) {
      return static_cast<std::size_t>(lattice::mix(static_cast<std::uint64_t>(s.i) * 0x9e3779b97f4a7c15u +
                                                   lattice::mix(static_cast<std::uint64_t>(s.j) * 8 + static_cast<unsigned>(s.level))));
    }
    const std::size_t most_, alone_;
    std::vector<std::atomic<Entry*>> slots_;
    std::atomic<std::size_t> count_ = 0;
  };

  std::pair<std::shared_ptr<Generation>, std::shared_ptr<Generation>> generations() {
    const std::lock_guard lock(mutex_);
    if (younger_->isFull()) {
      older_ = std::move(younger_);
      younger_ = std::make_shared<Generation>(areMany(most_) ? few() : most_, most_);
    }
    return {younger_, older_};
  }

  static bool areMany(std::size_t most) { return inAll_.load(std::memory_order_relaxed) > 4 * most; }
  std::size_t few() const { return most_ / 16 + 1; }

  inline static std::atomic<std::size_t> inAll_ = 0;  // values
  const std::size_t most_;
  std::mutex mutex_;
  std::shared_ptr<Generation> younger_, older_;
};

}  // namespace ridgecast::ground
