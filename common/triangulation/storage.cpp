#include "common/triangulation/storage.h"

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::triangulation {

void* reserve(std::size_t bytes) {
  constexpr std::size_t line = 64, huge = std::size_t{2} << 20, large = 16 * huge;
  const std::size_t alignment = bytes < large ? line : huge;
  void* const at = std::aligned_alloc(alignment, (std::max(bytes, line) + alignment - 1) / alignment * alignment);
  if (!at) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
  if (bytes >= large) madvise(at, bytes, MADV_HUGEPAGE);  // an offer; nothing is wrong where it is declined
#endif
  return at;
}

template <std::uint32_t N>
Pages<N>::Pages(std::uint32_t slots)
    : capacity_((slots + kSlots - 1) / kSlots * kSlots),
      pages_(capacity_ / kSlots),
      blocks_(capacity_ / kBlock),
      freePages_(capacity_ / kSlots) {
  regions_.push_back(std::make_unique<Region>());  // kOutside
  changed_.push_back(0);
}

template <std::uint32_t N>
RegionId Pages<N>::addRegion() {
  if (!unusedRegions_.empty()) {
    const RegionId id = unusedRegions_.back();
    unusedRegions_.pop_back();
    regions_[id] = std::make_unique<Region>();
    return id;
  }
  regions_.push_back(std::make_unique<Region>());
  changed_.push_back(0);
  return static_cast<RegionId>(regions_.size() - 1);
}

template <std::uint32_t N>
void Pages<N>::removeRegion(RegionId region) {
  expects(region != kOutside && regions_[region] && regions_[region]->pages.empty(), "a region that is removed is empty");
  regions_[region].reset();
  changed_[region] = 0;
  unusedRegions_.push_back(region);
}

template <std::uint32_t N>
void Pages<N>::adopt(RegionId from, RegionId to) {
  expects(from != to && hasRegion(from) && hasRegion(to), "one region adopts another");
  Region &giver = *regions_[from], &heir = *regions_[to];
  for (std::uint32_t page : giver.pages) {
    pages_[page].region = to;
    for (std::uint32_t block : pages_[page].blocks)
      if (block != kNoSlot) blocks_[block].region = to;
    pages_[page].place = static_cast<std::uint32_t>(heir.pages.size());
    heir.pages.push_back(page);
  }
  heir.open.insert(heir.open.end(), giver.open.begin(), giver.open.end());
  heir.fresh.insert(heir.fresh.end(), giver.fresh.begin(), giver.fresh.end());
  heir.count += giver.count;
  markChanged(to);
  giver.pages.clear();
  giver.open.clear();
  giver.fresh.clear();
  giver.count = 0;
}

template <std::uint32_t N>
void Pages<N>::list(std::uint32_t page) {
  const RegionId id = pages_[page].region;
  Region& region = *regions_[id];
  if (region.fresh.size() >= 2 * region.pages.size() + 8) {  // pages that went elsewhere, or came back and are named twice
    std::erase_if(region.fresh,
                  [&](std::uint32_t other) { return pages_[other].region != id || !std::exchange(pages_[other].listed, false); });
    for (std::uint32_t other : region.fresh) pages_[other].listed = true;
  }
  pages_[page].listed = true;
  region.fresh.push_back(page);
}

template <std::uint32_t N>
std::uint32_t Pages<N>::pageWithRoom(RegionId id) {
  Region& region = *regions_[id];
  while (!region.open.empty() && pages_[region.open.back()].alive == ~Mask{0}) {
    pages_[region.open.back()].open = false;
    region.open.pop_back();
  }
  if (region.open.empty()) addPages(id, 1);
  return region.open.empty() ? kNoSlot : region.open.back();
}

template <std::uint32_t N>
void Pages<N>::addPages(RegionId id, std::size_t slots) {
  Region& region = *regions_[id];
  const std::size_t before = region.pages.size(), wanted = before + (slots + kSlots - 1) / kSlots;
  // A region that is no longer small will fill them: blocks that lie together are read faster.
  std::vector<std::uint32_t> blocks(before > 0 ? (wanted - before) * kBlocks : (slots + kBlock - 1) / kBlock);
  {
    Lock lock(mutex_);
    for (; region.pages.size() < wanted && !pool_.empty(); pool_.pop_back()) region.pages.push_back(pool_.back());
    for (; region.pages.size() < wanted && untouched_ < capacity_ / kSlots; ++untouched_) region.pages.push_back(untouched_);
    blocks.resize(std::min(blocks.size(), (region.pages.size() - before) * kBlocks));
    for (std::uint32_t& block : blocks) block = freeBlock();
  }
  const std::size_t got = region.pages.size() - before;
  freePages_.fetch_sub(static_cast<std::uint32_t>(got), std::memory_order_relaxed);
  std::sort(region.pages.begin() + static_cast<std::ptrdiff_t>(before), region.pages.end());
  std::sort(blocks.begin(), blocks.end());
  for (std::size_t k = 0; k < got; ++k) {
    const std::uint32_t number = region.pages[before + k];
    Page& page = pages_[number];
    page = {0, 0, {}, id, static_cast<std::uint32_t>(before + k), true, false};
    for (std::uint32_t b = 0; b < kBlocks; ++b) {
      const std::size_t n = k * kBlocks + b;
      page.blocks[b] = n < blocks.size() ? blocks[n] : kNoSlot;
      if (n < blocks.size()) blocks_[blocks[n]] = {number * kBlocks + b, id};
    }
  }
  region.open.insert(region.open.end(), region.pages.rbegin(), region.pages.rbegin() + static_cast<std::ptrdiff_t>(got));
}

template <std::uint32_t N>
void Pages<N>::addBlock(std::uint32_t number, std::uint32_t k) {
  Page& page = pages_[number];
  {
    Lock lock(mutex_);
    page.blocks[k] = freeBlock();
  }
  blocks_[page.blocks[k]] = {number * kBlocks + k, page.region};
}

template <std::uint32_t N>
std::uint32_t Pages<N>::freeBlock() {
  expects(!blockPool_.empty() || untouchedBlocks_ < capacity_ / kBlock, "there are as many blocks as all pages can have");
  if (blockPool_.empty()) return untouchedBlocks_++;
  const std::uint32_t block = blockPool_.back();
  blockPool_.pop_back();
  return block;
}

template <std::uint32_t N>
std::uint32_t Pages<N>::allocate(RegionId id) {
  const std::uint32_t number = pageWithRoom(id);
  if (number == kNoSlot) return kNoSlot;
  Page& page = pages_[number];
  Region& region = *regions_[id];
  const auto index = static_cast<std::uint32_t>(std::countr_one(page.alive));
  if (page.blocks[index / kBlock] == kNoSlot) addBlock(number, index / kBlock);
  page.alive |= Mask{1} << index;
  page.fresh |= Mask{1} << index;
  if (!page.listed) list(number);
  ++region.count;
  markChanged(id);
  return slotAt(number, index);
}

template <std::uint32_t N>
void Pages<N>::release(std::uint32_t slot) {
  const std::uint32_t number = pageOf(slot);
  Page& page = pages_[number];
  Region& region = *regions_[page.region];
  const Mask bit = bitOf(slot);
  expects(page.alive & bit, "what is released is alive");
  page.alive &= ~bit;
  page.fresh &= ~bit;
  --region.count;
  markChanged(page.region);
  if (!page.open) {
    page.open = true;
    region.open.push_back(number);
  }
  if (region.count == 0) {
    giveBackAll(region);
  } else if (page.alive == 0 && region.open.back() != number) {
    // The page that is being filled stays: a change releases its cavity and fills it again at once.
    const auto open = std::find(region.open.begin(), region.open.end(), number);
    expects(open != region.open.end(), "a page with room is listed by its region");
    region.open.erase(open);
    region.pages[page.place] = region.pages.back();
    pages_[region.pages[page.place]].place = page.place;
    region.pages.pop_back();
    giveBack({&number, 1});
  }
}

template <std::uint32_t N>
void Pages<N>::giveBack(std::span<const std::uint32_t> pages) {
  const Lock lock(mutex_);
  pool_.insert(pool_.end(), pages.begin(), pages.end());
  freePages_.fetch_add(static_cast<std::uint32_t>(pages.size()), std::memory_order_relaxed);
  for (std::uint32_t page : pages)
    for (std::uint32_t block : pages_[page].blocks)
      if (block != kNoSlot) {
        blocks_[block].place = kNoSlot;
        blockPool_.push_back(block);
      }
}

template <std::uint32_t N>
void Pages<N>::giveBackAll(Region& region) {
  giveBack(region.pages);
  region.pages.clear();
  region.open.clear();
  region.fresh.clear();
}

template <std::uint32_t N>
void Pages<N>::drain(RegionId id) {
  Region& region = *regions_[id];
  for (std::uint32_t page : region.pages) pages_[page].alive = pages_[page].fresh = 0;
  giveBackAll(region);
  region.count = 0;
  markChanged(id);
}

template <std::uint32_t N>
std::vector<std::uint32_t> Pages<N>::keepFullest(Region& region) {
  std::vector<std::uint32_t> order = region.pages;
  // Equal ones in the order in which the region got them: page numbers depend on what else happened.
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return std::popcount(pages_[a].alive) > std::popcount(pages_[b].alive); });
  const std::size_t keep = std::min(order.size(), pagesKept(region.count));
  std::vector<std::uint32_t> emptied(order.begin() + static_cast<std::ptrdiff_t>(keep), order.end());
  order.resize(keep);
  region.pages = order;
  region.open.clear();
  for (std::uint32_t k = 0; k < order.size(); ++k) {
    Page& page = pages_[order[k]];
    page.place = k;
    page.open = page.alive != ~Mask{0};
    if (page.open) region.open.push_back(order[k]);
  }
  return emptied;
}

template <std::uint32_t N>
void Pages<N>::clear() {
  for (RegionId id = 0; id < regions_.size(); ++id) {
    auto& region = regions_[id];
    if (!region) continue;
    region->pages.clear();
    region->open.clear();
    region->fresh.clear();
    region->count = 0;
    changed_[id] = 1;
  }
  pool_.clear();
  blockPool_.clear();
  untouched_ = untouchedBlocks_ = 0;
  freePages_ = capacity_ / kSlots;
}

template <std::uint32_t N>
std::uint32_t Pages<N>::live() const {
  std::uint32_t sum = 0;
  for (const auto& region : regions_)
    if (region) sum += region->count;
  return sum;
}

template <std::uint32_t N>
std::uint32_t Pages<N>::pagesInUse() const {
  return capacity_ / kSlots - freePages_.load(std::memory_order_relaxed);
}

template class Pages<32>;
template class Pages<64>;

}  // namespace ridgecast::triangulation
