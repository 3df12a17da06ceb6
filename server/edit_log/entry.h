#pragma once
// An edit as an entry of a log that several servers share. An entry holds the edit as it was made, with all that was decided then, such as
// a road's heights: applying it needs nothing but the ground before it, so all servers have the same ground.
//
// In this order, little-endian: the byte 1, the version of this form; 4 bytes, the server that made the batch, 8 of the batch's tag, its
// own; 8 each of number, time and the ground's four sides; 4 and the key, 4 and the author, the lengths before the texts; the operation;
// 8 of a hash of all before.

#include <cstdint>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/edit_store/store.h"

namespace ridgecast::edit_log {

// Which append an entry came with. Entries that a server brings back after the log has lost them have none: nobody knows it any more.
struct Batch {
  std::uint32_t server = 0;
  std::uint64_t tag = 0;
  friend bool operator==(const Batch&, const Batch&) = default;
};

struct Entry {
  Batch batch;
  edit_store::Applied edit;
};

std::string pack(const Batch& batch, const edit_store::Applied& edit);
// Error: one sentence; damaged, or of another version.
Outcome<Entry> unpackEntry(std::string_view bytes);

// Of everything in an edit: equal for copies of it, whoever keeps them.
std::uint64_t identityOf(const edit_store::Applied& edit);

}  // namespace ridgecast::edit_log
