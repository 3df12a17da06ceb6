#include "server/edit_log/entry.h"

#include <bit>
#include <cstring>
#include <span>

#include "common/lattice/lattice.h"
#include "server/edit_log/tiles.h"

namespace ridgecast::edit_log {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr char kEntryVersion = 1;

std::uint64_t hashOfText(std::string_view text, std::uint64_t start) {
  return hashOfBytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, start);
}

template <class Number>
void put(std::string& out, Number value) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

void put(std::string& out, std::string_view text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out += text;
}

// False: there are too few bytes.
template <class Number>
bool take(std::string_view& from, Number& value) {
  if (from.size() < sizeof value) return false;
  std::memcpy(&value, from.data(), sizeof value);
  from.remove_prefix(sizeof value);
  return true;
}

bool take(std::string_view& from, std::string& text) {
  std::uint32_t size = 0;
  if (!take(from, size) || from.size() < size) return false;
  text = from.substr(0, size);
  from.remove_prefix(size);
  return true;
}

}  // namespace

std::string pack(const Batch& batch, const edit_store::Applied& edit) {
  std::string out;
  out.reserve(edit.bytes() + 40);
  out += kEntryVersion;
  put(out, batch.server);
  put(out, batch.tag);
  put(out, edit.number);
  put(out, edit.time);
  for (const lattice::Step side : {edit.ground.x0, edit.ground.z0, edit.ground.x1, edit.ground.z1}) put(out, std::int64_t{side});
  put(out, std::string_view(edit.key));
  put(out, std::string_view(edit.author));
  out += edit.operation;
  put(out, hashOfText(out, 0));
  return out;
}

Outcome<Entry> unpackEntry(std::string_view bytes) {
  Entry entry;
  std::uint64_t hash = 0;
  if (bytes.size() < 1 + sizeof hash) return Error{"it is too short"};
  std::memcpy(&hash, bytes.data() + bytes.size() - sizeof hash, sizeof hash);
  bytes.remove_suffix(sizeof hash);
  if (hashOfText(bytes, 0) != hash) return Error{"it is damaged"};
  if (bytes.front() != kEntryVersion)
    return Error{"it has form " + std::to_string(static_cast<unsigned char>(bytes.front())) + ", and this program reads form 1"};
  bytes.remove_prefix(1);
  std::int64_t sides[4] = {};
  bool isWhole =
      take(bytes, entry.batch.server) && take(bytes, entry.batch.tag) && take(bytes, entry.edit.number) && take(bytes, entry.edit.time);
  for (std::int64_t& side : sides) isWhole = isWhole && take(bytes, side);
  if (!isWhole || !take(bytes, entry.edit.key) || !take(bytes, entry.edit.author)) return Error{"it is too short"};
  entry.edit.ground = {sides[0], sides[1], sides[2], sides[3]};
  entry.edit.operation = bytes;
  return entry;
}

std::uint64_t identityOf(const edit_store::Applied& edit) {
  std::uint64_t hash = lattice::mix(edit.number + lattice::mix(static_cast<std::uint64_t>(edit.time)));
  for (const std::string_view text : {std::string_view(edit.key), std::string_view(edit.author), std::string_view(edit.operation)})
    hash = hashOfText(text, hash);
  for (const lattice::Step side : {edit.ground.x0, edit.ground.z0, edit.ground.x1, edit.ground.z1})
    hash = lattice::mix(hash + static_cast<std::uint64_t>(side));
  return hash;
}

}  // namespace ridgecast::edit_log
