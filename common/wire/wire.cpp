#include "common/wire/wire.h"

#include <google/protobuf/stubs/logging.h>

#include <type_traits>

#include "common/wire/tables.h"

namespace ridgecast::wire {
namespace {

// Protobuf would print to stderr what a peer sends wrong; the errors returned here say it instead.
[[maybe_unused]] const auto previousLogHandler = google::protobuf::SetLogHandler(nullptr);

template <class P, class V>
std::string encodeAs(const V& message) {
  P out;
  write(message, out);
  return out.SerializeAsString();
}

template <class P, class V>
Outcome<V> decodeAs(std::span<const std::uint8_t> bytes, std::size_t most) {
  if (bytes.size() > most)
    return Error{"the message has " + std::to_string(bytes.size()) + " bytes, at most " + std::to_string(most) + " are allowed"};
  Counts counts;
  Refusal refusal;
  P in;
  const bool wellFormed = scan<V, P>(bytes, counts, refusal) && in.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
  if (!refusal.empty()) return Error{refusal};
  const bool known = in.kind_case() != P::KIND_NOT_SET;
  if constexpr (std::is_constructible_v<V, UnknownKind>)
    if (wellFormed && !known && !bytes.empty()) return V(UnknownKind{});
  if (!wellFormed || !known) return Error{"The bytes are not a message of protocol version 1 (see PROTOCOL.md)."};
  V out;
  read(out, in, refusal);
  if (!refusal.empty()) return Error{refusal};
  return out;
}

}  // namespace

bool sessionNameIsValid(std::string_view name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
  };
  return !name.empty() && name.size() <= kMaxSessionBytes && std::all_of(name.begin(), name.end(), allowed);
}

namespace {
template <class Sent, class Message>
std::string refusalBy(const Message& message) {
  Sent in;
  write(message, in);
  Message out;
  Refusal refusal;
  read(out, in, refusal);
  return refusal;
}
}  // namespace

std::string refusalOf(const Ray& ray) { return refusalBy<pb::Ray>(ray); }
std::string refusalOf(const AskGround& ask) { return refusalBy<pb::AskGround>(ask); }

std::string encode(const ClientMessage& message) { return encodeAs<pb::ClientMessage>(message); }
std::string encode(const ServerMessage& message) { return encodeAs<pb::ServerMessage>(message); }

Outcome<ClientMessage> decodeClient(std::span<const std::uint8_t> bytes) {
  return decodeAs<pb::ClientMessage, ClientMessage>(bytes, kMaxClientMessageBytes);
}
Outcome<ServerMessage> decodeServer(std::span<const std::uint8_t> bytes) {
  return decodeAs<pb::ServerMessage, ServerMessage>(bytes, kMaxServerMessageBytes);
}

}  // namespace ridgecast::wire
