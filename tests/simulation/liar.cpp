#include "tests/simulation/liar.h"

#include <gtest/gtest.h>

#include <utility>

namespace ridgecast::simulation {

void Liar::leave() {
  if (line_) std::exchange(line_, nullptr)->cut({});
}

void Liar::lie() {
  if (line_) {
    for (std::uint64_t n = random_() % 50 == 0 ? 200 : 1; n > 0; --n) line_->say(message());
    return;
  }
  line_ = Line::open(directory_, timer_, {}, [this](const wire::ServerMessage& heard) {
    const auto* error = std::get_if<wire::ErrorMessage>(&heard);
    if (!error) return;
    EXPECT_FALSE(error->message.empty());
    EXPECT_NE(error->code, wire::ErrorCode::kInternal) << error->message;
    leave();
  });
  if (!line_) return;
  wire::Hello hello;
  hello.points = random_() % 2 == 0;
  hello.members = hello.clock = true;
  hello.pacing = random_() % 2 == 0 ? wire::Pacing::kLockstep : wire::Pacing::kFree;
  hello.settings.threshold = 20;
  hello.settings.triangleBudget = settings::kLeastBudget;
  if (random_() % 8 != 0) line_->say(hello);
}

wire::ClientMessage Liar::message() {
  const std::uint64_t number = random_() % 6, wild = random_();
  switch (random_() % 14) {
    case 0:
      return wire::Acknowledge{number, wild};
    case 1:
      return wire::ResendLeaves{{{static_cast<int>(number), static_cast<std::int64_t>(wild % 100), 3}}};
    case 2:
      return wire::ResendLeaves{};
    case 3:
      return wire::Resume{{{{2, 5, static_cast<std::int64_t>(number)}, wild}}};
    case 4:
      return wire::AskClock{wild};
    case 5:
      return wire::SetClock{wild % 2 == 0, wire::ClockMode::kScaled, static_cast<double>(number)};
    case 6:
      return wire::ClockStep{1000, true};
    case 7:
      return wire::StepDone{number};
    case 8:
      return wire::PassOver{number};
    case 9:
      return wire::ChangeSettings{{.threshold = 1.0 + static_cast<double>(number), .triangleBudget = settings::kLeastBudget}};
    case 10: {
      wire::Query query;
      query.id = number;
      query.x = query.z = {static_cast<lattice::Step>(wild >> 20)};
      return query;
    }
    case 11:
      return wire::Hello{};
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
