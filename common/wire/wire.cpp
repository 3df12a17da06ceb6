#include "common/wire/wire.h"

#include <algorithm>
#include <type_traits>

#include "common/outcome/contract.h"
#include "common/wire/tables.h"

namespace ridgecast::wire {
namespace {

template <class V>
using TagOf = typename TableOf<V>::type;

template <class V>
std::string encoded(const V& message) {
  Counted counted;
  write<TagOf<V>>(message, counted);
  std::string out;
  out.reserve(counted.bytes);
  write<TagOf<V>>(message, out);
  expects(out.size() <= counted.bytes, "a message is no longer than was counted");
  return out;
}

template <class V>
Outcome<V> decoded(Content bytes, std::size_t most) {
  if (bytes.size() > most)
    return Error{"the message has " + std::to_string(bytes.size()) + " bytes, at most " + std::to_string(most) + " are allowed"};
  V out;
  Verdict verdict;
  Found<TagOf<V>> found;
  const bool wellFormed = find<V>(bytes, found, verdict);
  const bool known = found.chosen != kRows<TagOf<V>>;
  if (wellFormed && known) {
    read<TagOf<V>>(out, found, verdict);
  } else if (wellFormed && !bytes.empty() && std::is_constructible_v<V, UnknownKind>) {
    if constexpr (std::is_constructible_v<V, UnknownKind>) out = UnknownKind{};
  } else {
    verdict.malformed = true;
  }
  if (!verdict.refusal.empty()) return Error{verdict.refusal};
  if (verdict.malformed) return Error{"The bytes are not a message of protocol version 1 (see PROTOCOL.md)."};
  return out;
}

// As if it had come.
template <class V>
std::string refusalBy(const V& message) {
  const std::string bytes = encoded(message);
  V out;
  Verdict verdict;
  read<TagOf<V>>(out, Content(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()), verdict);
  return verdict.refusal;
}

}  // namespace

bool sessionNameIsValid(std::string_view name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
  };
  return !name.empty() && name.size() <= kMaxSessionBytes && std::all_of(name.begin(), name.end(), allowed);
}

std::string refusalOf(const Ray& ray) { return refusalBy(ray); }
std::string refusalOf(const AskGround& ask) { return refusalBy(ask); }

std::string encode(const ClientMessage& message) { return encoded(message); }
std::string encode(const ServerMessage& message) { return encoded(message); }

std::string encodePart(const Members& part) { return encoded(part); }
std::string encodeMembers(std::string_view parts) {
  constexpr std::uint32_t kMembers = 4;  // of ServerMessage
  std::string out;
  out.reserve(parts.size() + 11);
  putTag(out, kMembers, WireType::kDelimited);
  putVarint(out, parts.size());
  return out.append(parts);
}

Outcome<ClientMessage> decodeClient(std::span<const std::uint8_t> bytes) { return decoded<ClientMessage>(bytes, kMaxClientMessageBytes); }
Outcome<ServerMessage> decodeServer(std::span<const std::uint8_t> bytes) { return decoded<ServerMessage>(bytes, kMaxServerMessageBytes); }

}  // namespace ridgecast::wire
