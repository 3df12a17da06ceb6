#pragma once
// Redis's protocol (RESP 2), by hiredis: commands to bytes, bytes to replies. Pure.

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"

struct redisReader;

namespace ridgecast::bus {

std::string command(const std::vector<std::string_view>& arguments);

struct Reply {
  enum class Kind { kNil, kText, kInteger, kArray, kError } kind = Kind::kNil;
  std::string text{};  // kText, kError
  long long integer = 0;
  std::vector<Reply> parts{};  // kArray

  bool isError() const { return kind == Kind::kError; }
  // The text of a part; empty: there is none.
  std::string_view part(std::size_t i) const { return i < parts.size() ? std::string_view(parts[i].text) : std::string_view(); }
};

// Takes replies apart as their bytes come. After an Error it has no more.
class ReplyReader {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{40} << 20;  // of one reply
  static constexpr std::size_t kMaxParts = 1 << 16;                // of one reply, with their parts

  ReplyReader();
  ReplyReader(const ReplyReader&) = delete;
  ReplyReader& operator=(const ReplyReader&) = delete;
  void feed(std::string_view bytes);
  // Nothing: more bytes are needed. Error: no Redis speaks like this, or the reply is larger than the limits.
  Outcome<std::optional<Reply>> next();

 private:
  struct End {
    void operator()(redisReader* reader) const;
  };
  std::size_t parts_ = 0;  // of the reply that has begun
  std::unique_ptr<redisReader, End> reader_;
};

}  // namespace ridgecast::bus
