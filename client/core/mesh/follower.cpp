#include "client/core/mesh/follower.h"

#include <algorithm>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::core {

Follower::Answer Follower::take(const wire::Iteration& iteration, Outcome<core::Scene::Prepared> prepared) {
  if (!prepared) return answer(iteration, prepared.error());
  expects(prepared->number == iteration.number, "what is taken was prepared of this iteration");
  scene_.take(std::move(*prepared));
  return answer(iteration, {});
}

Follower::Answer Follower::answer(const wire::Iteration& iteration, const Outcome<void>& applied) {
  Answer answer;
  if (!applied) scene_.clear();
  if (!applied || scene_.hash() != iteration.meshHash)
    answer.wrong = Error{"the mesh held after iteration " + std::to_string(iteration.number) + " is not the server's (" +
                         (applied ? "its hash differs" : applied.error().message) + ")"};
  const bool asked = std::exchange(asked_, answer.wrong.has_value());
  if (answer.wrong && (!asked || !applied)) answer.resend.emplace();
  answer.acknowledge = {iteration.number, scene_.hash()};
  return answer;
}

std::vector<wire::Resume> Follower::enter(const wire::World& world) {
  const std::string key = std::exchange(resumeKey_, world.resumeKey);
  const bool unnamed = points_ && world.revision >= 7 && scene_.hash() != 0;
  scene_.reconnect(unnamed);
  asked_ = false;
  if (unnamed) return {{{}, key, scene_.hash()}};
  const std::vector<wire::HeldLeaf> held = scene_.held();
  std::vector<wire::Resume> out;
  for (auto at = held.begin(); at != held.end();) {
    const auto end = at + std::min<std::ptrdiff_t>(held.end() - at, wire::kMaxResumeLeaves);
    out.push_back({{at, end}, {}, 0});
    at = end;
  }
  return out;
}

}  // namespace ridgecast::core
