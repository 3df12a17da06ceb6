#pragma once
// An edit's author. In logs and recordings it is one text: the client and, after a line feed, the name if there is one.

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

namespace ridgecast::edits {

inline constexpr std::size_t kMaxAuthorBytes = 128;  // of each of its two

struct Author {
  // As the server knows it: "token of NAME" or "address ADDRESS"; in logs without names, what it called itself.
  std::string client;
  std::string name;  // what it calls itself; proves nothing
  friend bool operator==(const Author&, const Author&) = default;
};

// Whether clients accept it as one of the two.
inline bool isFitForAuthor(std::string_view text) {
  return text.size() <= kMaxAuthorBytes && std::ranges::none_of(text, [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

inline std::string toText(const Author& author) { return author.name.empty() ? author.client : author.client + '\n' + author.name; }

inline std::string_view clientOf(std::string_view text) { return text.substr(0, text.find('\n')); }

// From any text. What clients would not accept is left out.
inline Author authorOf(std::string_view text) {
  const std::string_view client = clientOf(text), name = text.substr(std::min(client.size() + 1, text.size()));
  return {std::string(isFitForAuthor(client) ? client : ""), std::string(isFitForAuthor(name) ? name : "")};
}

}  // namespace ridgecast::edits
