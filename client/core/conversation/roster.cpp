#include "client/core/conversation/roster.h"

#include <string>
#include <utility>

namespace ridgecast::core {

std::string nameOf(const wire::Member& member) {
  return member.name.empty() || member.name.starts_with("ridgecast-") ? "Guest " + std::to_string(member.camera) : member.name;
}

Outcome<void> Roster::apply(const wire::Members& news, std::chrono::steady_clock::time_point now) {
  auto others = others_;
  const auto name = [](std::uint64_t camera) { return "member " + std::to_string(camera); };
  for (const wire::Member& m : news.joined)
    if (!others.emplace(m.camera, Other{m, now}).second) return Error{name(m.camera) + " joined twice"};
  for (const wire::Moved& m : news.moved) {
    const auto it = others.find(m.camera);
    if (it == others.end()) return Error{name(m.camera) + " moved but had not joined"};
    it->second.member.moved = m;
    it->second.heard = now;
  }
  for (const std::uint64_t camera : news.left)
    if (others.erase(camera) == 0) return Error{name(camera) + " left but had not joined"};
  for (const std::uint64_t camera : news.faded)
    if (others.erase(camera) == 0) return Error{name(camera) + " faded but had not joined"};
  others_ = std::move(others);
  count_ = news.others;
  if (news.crowd) crowd_ = *news.crowd;
  ++version_;
  return {};
}

}  // namespace ridgecast::core
