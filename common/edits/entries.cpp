#include "common/edits/entries.h"

#include "common/outcome/contract.h"

namespace ridgecast::edits {

std::string_view Entries::packed(std::size_t k) const {
  expects(k < size_, "an edit that is read is there");
  const Block& block = blockOf(k);
  const std::size_t begin = block.begin(k % kBlock);
  return std::string_view(block.bytes).substr(begin, block.ends[k % kBlock] - begin);
}

void Entries::add(std::string_view packed, std::uint32_t undos) {
  const std::size_t k = size_ % kBlock;
  if (size_ / kBlock == blocks_.size()) blocks_.push_back(std::make_unique<Block>());
  Block& block = *blocks_.back();
  block.bytes += packed;
  block.ends[k] = static_cast<std::uint32_t>(block.bytes.size());
  block.undos[k] = undos;
  if (k + 1 == kBlock) block.bytes.shrink_to_fit();
  ++size_;
}

void Entries::removeLast() {
  expects(size_ > 0, "there is an edit to remove");
  --size_;
  if (size_ / kBlock + 1 < blocks_.size()) blocks_.pop_back();
  Block& block = blockOf(size_);
  block.bytes.resize(block.begin(size_ % kBlock));
}

}  // namespace ridgecast::edits
