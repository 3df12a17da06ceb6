#pragma once
// A file or a text from a server by HTTP, in the clear or under TLS as the URL says.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <stop_token>
#include <string>

#include "client/core/conversation/url.h"
#include "common/outcome/outcome.h"

namespace ridgecast::link {

struct Progress {
  std::chrono::milliseconds waited{0};
  std::uint64_t received = 0, total = 0;  // bytes; total 0: the answer has not begun
  std::string work;                       // how far the server is, in its words, at most 80 characters; empty: it does not say
};

// Blocks. `target`: path and query, already percent-encoded. Writes the file whole or not at all. Calls `tell` about ten times a second
// and at the end. Returns the number of bytes.
// Errors: as Connection::open; the server's own sentence when it refuses; no answer within `timeout`, or `timeout` without a byte during
// one; the file cannot be written.
Outcome<std::uint64_t> download(const core::Url& url, const std::string& target, const std::filesystem::path& file,
                                std::chrono::milliseconds timeout, const std::function<void(const Progress&)>& tell);

// The answer to a request without a body, whatever its status.
struct HttpAnswer {
  int status = 0;
  std::string text;  // its first 4 KiB, fit for a terminal
};
// Blocks. `target`: as download()'s. Errors: as download()'s, but for the server's refusals; given up because `stop` asks for it.
Outcome<HttpAnswer> request(const core::Url& url, const std::string& method, const std::string& target, std::chrono::milliseconds timeout,
                            std::stop_token stop = {});

// As download() into memory, of at most `most` bytes; also gives up when `stop` asks it to.
Outcome<std::string> fetch(const core::Url& url, const std::string& target, std::size_t most, std::chrono::milliseconds timeout,
                           std::stop_token stop = {});

}  // namespace ridgecast::link
