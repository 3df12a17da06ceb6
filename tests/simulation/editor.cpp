#include "tests/simulation/editor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "common/edits/json.h"
#include "common/wire/wire.h"
#include "tests/support/random_edits.h"

namespace ridgecast::simulation {

bool Editor::hasRoom() const { return open_.size() < wire::kMaxEdits; }

void Editor::edit(lattice::Point near, const Say& say) {
  if (!hasRoom()) return;
  edits::Operation operation = testing_support::randomOperation(random_, near);
  const std::uint64_t known = truth_.known();
  if (known > 0 && random_() % 4 == 0) operation = {edits::Undo{random_() % 2 == 0 ? known : 1 + random_() % (known + 2)}, 0};
  const bool hasKey = random_() % 4 != 0;
  Request request{{hasKey ? "key " + std::to_string(++keys_) : "", std::move(operation)}};
  if (hasKey && random_() % 8 == 0 && open_.size() + 1 < wire::kMaxEdits) {  // twice, to be sure
    request.sent = 1;
    send(request, say);
    if (random_() % 4 == 0) request.asked.operation = testing_support::randomOperation(random_, near);  // or another by mistake
  }
  send(std::move(request), say);
}

void Editor::ask(edits::Operation operation, const Say& say) { send({{"key " + std::to_string(++keys_), std::move(operation)}}, say); }

void Editor::send(Request request, const Say& say) {
  ++request.sent;
  request.known = truth_.known();
  request.lostEnds = truth_.lostEnds();
  wire::Edit edit{0, request.asked.key, edits::toJson(request.asked.operation)};
  open_[++ids_] = std::move(request);
  say(std::move(edit), [this, id = ids_](const Outcome<wire::EditAnswer>& answer) { take(id, answer); });
}

void Editor::connected(const wire::World& world, const Say& say, bool mayBeBehind) {
  EXPECT_TRUE(world.edit >= known_ || mayBeBehind) << author_ << " is sent ground older than what it knows";
  truth_.knows(world.edit);
  known_ = std::max(known_, world.edit);
  for (Request& request : std::exchange(lost_, {}))
    if (hasRoom()) send(std::move(request), say);
}

void Editor::lost() {
  for (auto& [id, request] : std::exchange(open_, {}))
    if (!request.asked.key.empty() && random_() % 8 != 0) lost_.push_back(std::move(request));
}

void Editor::take(std::uint64_t id, const Outcome<wire::EditAnswer>& answer) {
  auto request = open_.extract(id);
  if (!request) return;  // it was lost
  const auto& [asked, sent, knownThen, lostEndsThen] = request.mapped();
  wasRefused_ = !answer;
  if (wasRefused_) {
    static constexpr const char* kReasons[] = {"Too many or too large edits", "edits of this session wait", "of your edits wait",
                                               "There is no edit", "is undone already", "no room on the disk", "is that of another edit",
                                               "ran out of memory",
                                               // Of several servers:
                                               "cannot be reached", "wait for the first one", "no room", "has ended"};
    const std::string& refusal = answer.error().message;
    EXPECT_TRUE(std::ranges::any_of(kReasons, [&](const char* r) { return refusal.find(r) != std::string::npos; })) << refusal;
    const auto* undo = std::get_if<edits::Undo>(&asked.operation.what);
    EXPECT_FALSE(undo && undo->edit <= knownThen && refusal.find("There is no edit") != refusal.npos && lostEndsThen == truth_.lostEnds())
        << "somebody knew it: " << refusal;
    if (refusal.find("before it was known") != refusal.npos) {
      if (!asked.key.empty()) lost_.push_back(std::move(request.mapped()));
      return;
    }
    if (sent == 1) truth_.refused(author_, asked.key);
    return;
  }
  EXPECT_NE(answer->number, 0u) << author_;
  known_ = std::max(known_, answer->number);
  truth_.acknowledged(answer->number, author_, asked);
}

void Editor::take(const std::vector<wire::MadeEdit>& edits) {
  for (const wire::MadeEdit& made : edits) {
    EXPECT_EQ(made.number, ++followed_) << author_ << " is not told of each edit once and in order";
    truth_.told(made);
  }
  known_ = std::max(known_, followed_);
}

}  // namespace ridgecast::simulation
