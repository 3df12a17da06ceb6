#pragma once
// A small file from elsewhere, by HTTPS: the keys of the tokens' issuer. The server asks nobody else for anything.

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::net {

struct HttpsUrl {
  std::string host, port = "443", target = "/";
  // https://HOST[:PORT][/PATH]. Error: one sentence.
  static Outcome<HttpsUrl> parse(std::string_view text);
};

// The body of a 200; other answers, redirections among them, are errors. The host must have a certificate from `authorities` (a file, PEM);
// empty: from those that this system trusts. Blocks. Error: one sentence; a timeout, a stop, more than `most` bytes.
Outcome<std::string> fetch(const HttpsUrl& from, const std::filesystem::path& authorities, std::size_t most,
                           std::chrono::milliseconds timeout, const std::stop_token& stop);

}  // namespace ridgecast::net
