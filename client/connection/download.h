#pragma once
// One file from a server by HTTP, in the clear or under TLS as the URL says.

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "client/connection/connection.h"
#include "common/outcome/outcome.h"

namespace ridgecast::connection {

struct Progress {
  std::chrono::milliseconds waited{0};
  std::uint64_t received = 0, total = 0;  // bytes; total 0: the answer has not begun
  std::string work;                       // how far the server is, in its words, at most 80 characters; empty: it does not say
};

// Blocks. `target`: path and query, already percent-encoded. Writes the file whole or not at all. Calls `tell` about ten times a second
// and at the end. Returns the number of bytes.
// Errors: as Connection::open; the server's own sentence when it refuses; no answer within `timeout`, or `timeout` without a byte while
// one comes; the file cannot be written.
Outcome<std::uint64_t> download(const Url& url, const std::string& target, const std::filesystem::path& file,
                                std::chrono::milliseconds timeout, const std::function<void(const Progress&)>& tell);

}  // namespace ridgecast::connection
