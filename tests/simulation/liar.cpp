#include "tests/simulation/liar.h"

#include <gtest/gtest.h>

#include <iterator>
#include <utility>

#include "common/edits/author.h"
#include "common/edits/json.h"
#include "tests/support/random_edits.h"

namespace ridgecast::simulation {

void Liar::leave() {
  if (line_) std::exchange(line_, nullptr)->cut({});
}

void Liar::flood() {
  for (std::size_t n = 0; line_ && n < wire::kMaxEdits + 20; ++n)
    line_->say(wire::Edit{100 + n, "", edits::toJson(testing_support::randomOperation(random_, near_))});
}

void Liar::lie() {
  if (line_) {
    if (random_() % 100 == 0) {
      for (std::size_t n = 0; n < wire::kMaxEdits + 20; ++n) line_->say(edit());
      return;
    }
    for (std::uint64_t n = random_() % 50 == 0 ? 200 : 1; n > 0; --n) line_->say(message());
    return;
  }
  const auto hear = [this](const std::string& frame) {
    const wire::ServerMessage heard = testing_support::decoded(frame);
    if (const auto* answer = std::get_if<wire::EditAnswer>(&heard)) take(*answer);
    const auto* error = std::get_if<wire::ErrorMessage>(&heard);
    if (!error) return;
    EXPECT_FALSE(error->message.empty());
    EXPECT_NE(error->code, wire::ErrorCode::kInternal) << error->message;
    leave();
  };
  Line::open(server_, std::string(directory::kDefaultName), "liar", timer_, {}, hear, [this](auto line) { line_ = std::move(line); });
  if (!line_) return;
  wire::Hello hello;
  hello.clientName = name_ = random_() % 2 == 0 ? "member" : "";  // as members do
  hello.edits = random_() % 2 == 0;
  hello.editsAfter = random_() % 3 == 0 ? random_() : random_() % 20;
  hello.points = random_() % 2 == 0;
  hello.members = hello.clock = true;
  hello.pacing = random_() % 2 == 0 ? wire::Pacing::kLockstep : wire::Pacing::kFree;
  hello.settings.threshold = 20;
  hello.settings.triangleBudget = settings::kMinBudget;
  if (random_() % 8 != 0)
    line_->say(hello);
  else
    name_ = "liar";  // its next hello will be the first
}

void Liar::take(const wire::EditAnswer& answer) {
  EXPECT_NE(answer.number == 0, answer.refusal.empty());
  if (answer.number != 0) truth_.acknowledged(answer.number, edits::toText({"liar", name_}), {});
}

// The same few ids and keys for whatever it asks.
wire::Edit Liar::edit() {
  const std::uint64_t number = random_() % 9;
  return {number, number % 3 == 0 ? "" : "key " + std::to_string(number), operation()};
}

std::string Liar::operation() {
  static constexpr const char* kWrong[] = {"",
                                           "null",
                                           "[]",
                                           R"({"op":"undo"})",
                                           R"({"op":"undo","edit":0})",
                                           R"({"op":"undo","edit":-1})",
                                           R"({"op":"undo","edit":1.5})",
                                           R"({"op":"undo","edit":18446744073709551615})",
                                           R"({"op":"undo","edit":1e300})",
                                           R"({"op":"raise","x":1e18,"z":0,"radius":5,"by":1})",
                                           R"({"op":"raise","x":0,"z":0,"radius":-5,"by":1})",
                                           R"({"op":"raise","x":0,"z":0,"radius":1e9,"by":1})",
                                           R"({"op":"raise","x":0,"z":0,"radius":5,"by":1e9})",
                                           R"({"op":"crater","x":"0","z":null,"radius":5,"depth":1})",
                                           R"({"op":"level","polygon":[[0,0],[1,1]],"height":0})",
                                           R"({"op":"road","line":[[0,0],[0,0]],"width":5})",
                                           R"({"op":"road","line":[[0,0,0],[1e7,0,0]],"width":5})",
                                           R"({"op":"stamp","x":0,"z":0,"columns":0,"samples":[1,2]})",
                                           R"({"op":"smooth","x":0,"z":0,"radius":64,"passes":1000000})",
                                           R"({"op":"crater","op":"undo","x":0,"z":0,"radius":5,"depth":1,"edit":1})"};
  std::string json = edits::toJson(testing_support::randomOperation(random_, near_));
  switch (random_() % 6) {
    case 0:
      return kWrong[random_() % std::size(kWrong)];
    case 1:
      return json.substr(0, random_() % json.size());
    case 2:
      json[random_() % json.size()] = static_cast<char>(0x20 + random_() % 95);
      return json;
    case 3:
      return std::string(random_() % 5000, '[');
    case 4:
      return R"({"op":"undo","edit":)" + std::to_string(random_() % 2 == 0 ? random_() : random_() % 50) + "}";
    default:
      return json;
  }
}

wire::ClientMessage Liar::message() {
  const std::uint64_t number = random_() % 6, wild = random_();
  switch (random_() % 18) {
    case 0:
      return wire::Acknowledge{number, wild};
    case 1:
      return wire::ResendLeaves{{{static_cast<int>(number), static_cast<std::int64_t>(wild % 100), 3}}};
    case 2:
      return wire::ResendLeaves{};
    case 3:
      return wire::Resume{{{{2, 5, static_cast<std::int64_t>(number)}, wild}}, {}, 0};
    case 4:
      return wire::AskClock{wild};
    case 5:
      return wire::SetClock{wild % 2 == 0, wire::ClockMode::kScaled, static_cast<double>(number), wild % 100'000'000};
    case 6:
      return wire::ClockStep{1000, true};
    case 7:
      return wire::StepDone{number};
    case 8:
      return wire::PassOver{number};
    case 9:
      return wire::ChangeSettings{{.threshold = 1.0 + static_cast<double>(number), .triangleBudget = settings::kMinBudget}};
    case 10: {
      wire::Query query;
      query.id = number;
      query.x = query.z = {static_cast<lattice::Step>(wild >> 20)};
      return query;
    }
    case 11: {
      wire::Hello again;
      again.clientName = "liar";
      return again;
    }
    case 12:
    case 13:
    case 14:
      return edit();
    default: {
      camera::Camera camera;
      camera.pose.x = static_cast<lattice::Step>(wild % 3'000'000);
      camera.pose.y = 2000;
      camera.projection = {.verticalFov = 1.0, .width = 160, .height = 90};
      return wire::PoseMessage{1 + wild % 1000, camera, {}};
    }
  }
}

}  // namespace ridgecast::simulation
