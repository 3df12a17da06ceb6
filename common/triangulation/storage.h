#pragma once
// Slots of fixed size, handed out in pages that belong to one region each. Knows ids, not records.
//
// A page has two masks: `alive` (the slot is in use) and `fresh` (in use, and neither taken nor cleared since). Emptied pages go back to
// one pool and are the first to be reused, so resident memory follows what is alive.
//
// A page's slots lie in four blocks, and it has only those that it uses: many regions are small. A slot's id says where its record lies:
// its block's number x kBlock + its place there. pageOf() and indexOf() say which slot of which page it is.
//
// Threads: allocate and release for different regions may run at the same time; the pools of free pages and blocks are behind a mutex.

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"

namespace ridgecast::triangulation {

using RegionId = std::uint32_t;
inline constexpr RegionId kOutside = 0;
inline constexpr std::uint32_t kNoSlot = 0xffffffffu;

#ifdef __wasi__  // has no threads
struct Mutex {};
struct Lock {
  explicit Lock(Mutex&) {}
};
#else
using Mutex = std::mutex;
using Lock = std::lock_guard<std::mutex>;
#endif

// Room for records that are written before they are read: not resident until touched. Arrays of 32 MiB and more, as of a mesh of half a
// million triangles, request huge pages, which save a tenth of an insertion's time in address translation and page faults, for up to 2 MiB
// more resident memory each.
void* reserve(std::size_t bytes);  // cache-line aligned; throws std::bad_alloc; release with std::free
template <class T>
class Records {
 public:
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T> && alignof(T) <= 64);
  explicit Records(std::size_t count) : at_(static_cast<T*>(reserve(count * sizeof(T)))) {}
  T& operator[](std::size_t k) { return at_.get()[k]; }
  const T& operator[](std::size_t k) const { return at_.get()[k]; }
  T* get() { return at_.get(); }
  const T* get() const { return at_.get(); }

 private:
  struct Free {
    void operator()(T* p) const { std::free(p); }
  };
  std::unique_ptr<T, Free> at_;
};

struct Move {  // of a record to another slot
  std::uint32_t from, to;
};

template <std::uint32_t N>  // slots of a page, 32 or 64
class Pages {
 public:
  static constexpr std::uint32_t kSlots = N, kBlocks = 4, kBlock = N / kBlocks;
  using Mask = std::conditional_t<N == 64, std::uint64_t, std::uint32_t>;  // a bit for each slot
  static_assert(std::numeric_limits<Mask>::digits == N);

  explicit Pages(std::uint32_t slots);

  RegionId addRegion();
  void removeRegion(RegionId region);      // must be empty
  void adopt(RegionId from, RegionId to);  // the pages of one become the other's, slots and all
  std::size_t regionLimit() const { return regions_.size(); }
  bool hasRegion(RegionId region) const { return region < regions_.size() && regions_[region] != nullptr; }

  std::uint32_t allocate(RegionId region);  // a fresh slot; kNoSlot when there is none left
  // Allocates slots in `region` for records moving there, page by page: fills in every `to`, as fresh as `from`, and calls take(from, to).
  // There must be room (hasFree).
  template <class F>
  void receive(RegionId region, std::span<Move> moves, F&& take);
  void release(std::uint32_t slot);
  // Reuses the slot for a new record of the same region: like release and allocate, without the search. The caller marks the region
  // changed.
  void renew(std::uint32_t slot) { setFresh(slot); }
  void clear();                 // releases every slot; regions stay
  void drain(RegionId region);  // releases every slot of a region
  // Whether a region holds a quarter more pages than needed; compact() fixes that, with move(from, to) for every slot that moves.
  bool sparse(RegionId region) const {
    const std::size_t count = regions_[region]->count, needed = (count + kSlots - 1) / kSlots;
    return regions_[region]->pages.size() > std::max(pagesKept(count), needed + needed / 4);
  }
  template <class F>
  void compact(RegionId region, F&& move);
  // Whether at least `pages` pages are free: checked before a change that needs a few slots in unknown regions.
  bool hasFree(std::uint32_t pages) const { return freePages_.load(std::memory_order_relaxed) >= pages; }

  std::uint32_t pageOf(std::uint32_t slot) const { return blocks_[slot / kBlock].place / kBlocks; }
  std::uint32_t indexOf(std::uint32_t slot) const { return blocks_[slot / kBlock].place % kBlocks * kBlock + slot % kBlock; }
  std::uint32_t slotAt(std::uint32_t page, std::uint32_t index) const {
    return pages_[page].blocks[index / kBlock] * kBlock + index % kBlock;
  }
  // The number of a page's block; kNoSlot where it has none.
  std::uint32_t blockOf(std::uint32_t page, std::uint32_t k) const { return pages_[page].blocks[k]; }
  Mask slotsOf(std::uint32_t page) const {  // those in blocks that it has
    Mask slots = 0;
    for (std::uint32_t k = 0; k < kBlocks; ++k)
      if (blockOf(page, k) != kNoSlot) slots |= (~Mask{0} >> (kSlots - kBlock)) << (k * kBlock);
    return slots;
  }
  template <class F>
  void forEachBlock(std::uint32_t page, F&& f) const {  // that the page has
    for (std::uint32_t block : pages_[page].blocks)
      if (block != kNoSlot) f(block);
  }
  void prefetch(std::uint32_t page) const { __builtin_prefetch(&pages_[page]); }

  RegionId regionOf(std::uint32_t slot) const { return blocks_[slot / kBlock].region; }
  bool alive(std::uint32_t slot) const {
    return blocks_[slot / kBlock].place != kNoSlot && ((pages_[pageOf(slot)].alive >> indexOf(slot)) & 1);
  }
  bool fresh(std::uint32_t slot) const { return (pages_[pageOf(slot)].fresh >> indexOf(slot)) & 1; }
  void setFresh(std::uint32_t slot) {
    Page& page = pages_[pageOf(slot)];
    page.fresh |= bitOf(slot);
    if (!page.listed) list(pageOf(slot));
  }
  void clearFresh(std::uint32_t slot) { pages_[pageOf(slot)].fresh &= ~bitOf(slot); }

  std::uint32_t count(RegionId region) const { return regions_[region]->count; }
  bool changed(RegionId region) const { return changed_[region] != 0; }
  void markChanged(RegionId region) {
    if (changed_[region] == 0) changed_[region] = 1;  // avoids needless writes: other threads' flags share the cache line
  }
  void clearChanged(RegionId region) { changed_[region] = 0; }
  std::uint32_t live() const;
  std::uint32_t capacity() const { return capacity_; }
  std::uint32_t pagesInUse() const;
  std::uint32_t blocksInUse() const { return untouchedBlocks_ - static_cast<std::uint32_t>(blockPool_.size()); }

  const std::vector<std::uint32_t>& pagesOf(RegionId region) const { return regions_[region]->pages; }
  Mask aliveMask(std::uint32_t page) const { return pages_[page].alive; }
  Mask freshMask(std::uint32_t page) const { return pages_[page].fresh; }

  template <class F>
  void forEach(RegionId region, F&& f) const {
    for (std::uint32_t page : regions_[region]->pages) forEachIn(page, pages_[page].alive, f);
  }
  template <class F>
  void forEachIn(std::uint32_t page, Mask slots, F&& f) const {
    for (; slots != 0; slots &= slots - 1) f(slotAt(page, static_cast<std::uint32_t>(std::countr_zero(slots))));
  }
  // Calls f(page, slots) for the region's pages with fresh slots, which are not fresh any more.
  template <class F>
  void takeFresh(RegionId region, F&& f) {
    for (std::uint32_t number : regions_[region]->fresh) {
      Page& page = pages_[number];
      if (page.region != region || !page.listed) continue;  // it went elsewhere, or came back and is listed twice
      page.listed = false;
      if (page.fresh != 0) f(number, std::exchange(page.fresh, 0));
    }
    regions_[region]->fresh.clear();
  }
  // Entries for takeFresh(), called or not: at most twice the region's pages, and eight.
  std::size_t listLength(RegionId region) const { return regions_[region]->fresh.size(); }
  template <class F>
  void forEachFresh(RegionId region, F&& f) const {
    for (std::uint32_t page : regions_[region]->pages) forEachIn(page, pages_[page].fresh, f);
  }

 private:
  struct Page {
    Mask alive, fresh;
    std::uint32_t blocks[kBlocks];
    RegionId region;
    std::uint32_t place;  // index in its region's list of pages
    bool open;            // in its region's list of pages with room
    bool listed;          // and in that of pages that may have fresh slots
  };
  struct Block {
    std::uint32_t place;  // its page x kBlocks + which of its blocks it is; kNoSlot: unused
    RegionId region;
  };
  struct alignas(64) Region {  // a line of its own: different threads fill neighbours
    std::vector<std::uint32_t> pages, open;
    std::vector<std::uint32_t> fresh;  // every page with fresh slots, and others
    std::uint32_t count = 0;
  };

  Mask bitOf(std::uint32_t slot) const { return Mask{1} << indexOf(slot); }
  void list(std::uint32_t page);
  void giveBack(std::span<const std::uint32_t> pages);
  void giveBackAll(Region& region);
  void addPages(RegionId id, std::size_t slots);  // as many as are free, with blocks for this many slots
  void addBlock(std::uint32_t page, std::uint32_t k);
  std::uint32_t freeBlock();                // under the mutex; there are as many as all pages can have
  std::uint32_t pageWithRoom(RegionId id);  // kNoSlot when there is none left
  // Pages with room for this many slots and a sixteenth more.
  static std::size_t pagesKept(std::size_t count) { return (count + count / 16 + kSlots - 1) / kSlots; }
  // Keeps the fullest of these; returns the others, to be emptied.
  std::vector<std::uint32_t> keepFullest(Region& region);

  std::uint32_t capacity_;
  Records<Page> pages_;
  Records<Block> blocks_;
  std::vector<std::unique_ptr<Region>> regions_;  // null: unused id
  std::vector<std::uint8_t> changed_;             // by region; contiguous, because many are read at once
  std::vector<RegionId> unusedRegions_;
  Mutex mutex_;
  std::vector<std::uint32_t> pool_;  // released pages, last in first out
  std::uint32_t untouched_ = 0;      // pages from here on were never used
  std::vector<std::uint32_t> blockPool_;
  std::uint32_t untouchedBlocks_ = 0;
  std::atomic<std::uint32_t> freePages_;
};

template <std::uint32_t N>
template <class F>
void Pages<N>::receive(RegionId id, std::span<Move> moves, F&& take) {
  // All at once: taken one by one, in turn with other threads, pages would lie scattered.
  expects(hasRegion(id), "records move to a region that is there");
  if (regions_[id]->open.empty()) addPages(id, moves.size());
  for (std::size_t n = 0; n < moves.size();) {
    const std::uint32_t number = pageWithRoom(id);
    if (number == kNoSlot) throw std::bad_alloc();
    Page& page = pages_[number];
    Mask alive = 0, made = 0;  // the page is written once: others may write its neighbours
    for (Mask room = ~page.alive; room != 0 && n < moves.size(); room &= room - 1, ++n) {
      const Mask bit = room & -room;
      const auto index = static_cast<std::uint32_t>(std::countr_zero(room));
      if (page.blocks[index / kBlock] == kNoSlot) addBlock(number, index / kBlock);
      moves[n].to = slotAt(number, index);
      alive |= bit;
      if (fresh(moves[n].from)) made |= bit;
      take(moves[n].from, moves[n].to);
    }
    page.alive |= alive;
    page.fresh |= made;
    if (made != 0 && !page.listed) list(number);
    regions_[id]->count += static_cast<std::uint32_t>(std::popcount(alive));
  }
  if (!moves.empty()) markChanged(id);
}

template <std::uint32_t N>
template <class F>
void Pages<N>::compact(RegionId id, F&& move) {
  Region& region = *regions_[id];
  for (std::uint32_t page : keepFullest(region)) {
    const Mask alive = pages_[page].alive, fresh = pages_[page].fresh;
    for (Mask m = alive; m != 0; m &= m - 1) {
      const auto k = static_cast<std::uint32_t>(std::countr_zero(m));
      --region.count;
      const std::uint32_t to = allocate(id);
      expects(to != kNoSlot, "the fullest pages have room for what lay in the others");
      if (!((fresh >> k) & 1)) clearFresh(to);
      move(slotAt(page, k), to);
    }
    pages_[page].alive = pages_[page].fresh = 0;
    giveBack({&page, 1});
  }
}

// Vertices use little of each page, so their pages are small; triangles use much, and every iteration reads all of it. A camera holds 1,600
// regions, most of them small: without blocks, half of its records' memory would be empty, seven eighths for a mesh of 10,000 triangles.
using TrianglePages = Pages<64>;
using VertexPages = Pages<32>;
extern template class Pages<32>;
extern template class Pages<64>;

}  // namespace ridgecast::triangulation
