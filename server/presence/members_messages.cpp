#include "server/presence/members_messages.h"

#include <span>
#include <utility>
#include <variant>

#include "common/wire/wire.h"

namespace ridgecast::presence {

namespace {

std::string messageOf(const std::string& parts) { return MembersMessages::kFormat + wire::encodeMembers(parts); }

constexpr std::size_t kFrame = 16;  // at most, around the parts

}  // namespace

void MembersMessages::put(const wire::Members& part) {
  const std::string bytes = wire::encodePart(part);
  if (parts_.size() + bytes.size() + kFrame > kMaxBytes) done_.push_back(messageOf(std::exchange(parts_, {})));
  parts_ += bytes;
}

void MembersMessages::add(const wire::Member& member) {
  wire::Members part;
  part.joined.push_back(member);
  put(part);
}

void MembersMessages::left(std::uint64_t camera) {
  wire::Members part;
  part.left.push_back(camera);
  put(part);
}

std::vector<std::string> MembersMessages::take() {
  if (!parts_.empty()) done_.push_back(messageOf(std::exchange(parts_, {})));
  return std::move(done_);
}

Outcome<wire::Members> membersOf(const std::string& message) {
  if (message.empty() || message.front() != MembersMessages::kFormat || message.size() > MembersMessages::kMaxBytes)
    return Error{"it has another format than this server's; servers of one world have the same version"};
  auto decoded = wire::decodeServer(std::span(reinterpret_cast<const std::uint8_t*>(message.data()), message.size()).subspan(1));
  if (!decoded) return decoded.error();
  auto* members = std::get_if<wire::Members>(&*decoded);
  if (!members) return Error{"it holds no members"};
  for (const wire::Member& member : members->joined)
    if (member.camera == 0) return Error{"a member has no number"};
  return std::move(*members);
}

}  // namespace ridgecast::presence
