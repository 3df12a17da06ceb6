// A recording: the file of a part (first byte odd), or the records of a block. Whatever is read can be written, and is read again as it
// was.
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string>

#include "server/recording/reader.h"

namespace {

using namespace ridgecast::recording;

void takeBlock(std::span<const std::uint8_t> block, Decoder& decoder, Encoder& encoder, Decoder& again) {
  while (!block.empty()) {
    const auto record = decoder.next(block);
    if (!record) {
      if (record.error().message.empty()) std::abort();
      return;
    }
    Bytes written;
    if (!encoder.put(*record, written)) std::abort();
    std::span<const std::uint8_t> rest = written;
    const auto same = again.next(rest);
    if (!same || !(*same == *record) || !rest.empty()) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  Decoder decoder, again;
  Encoder encoder;
  if ((data[0] & 1) == 0) {
    takeBlock({data + 1, size - 1}, decoder, encoder, again);
    return 0;
  }
  std::istringstream in(std::string(reinterpret_cast<const char*>(data + 1), size - 1));
  Blocks blocks(in);
  while (const auto block = blocks.next()) {
    if (block->size() > kMaxBlockBytes) std::abort();
    takeBlock(*block, decoder, encoder, again);
  }
  return 0;
}
