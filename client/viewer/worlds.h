#pragma once
// The sessions and terrains that a server has, as its HTTP routes list them (/v1/sessions, /v1/terrains).

#include <cstdint>
#include <future>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "client/link/connection.h"
#include "common/outcome/outcome.h"

namespace ridgecast::viewer {

struct Worlds {
  struct Session {
    std::string name, terrain;
    std::uint32_t seed = 0;
    std::uint64_t members = 0;
  };
  struct Terrain {
    std::string name, summary;
  };
  static constexpr std::size_t kMax = 1000;  // of each; more are not shown
  std::vector<Session> sessions;
  std::vector<Terrain> terrains;  // none if the server makes no sessions
};

// The answers of the two routes. Error: they are not what a server answers.
Outcome<Worlds> worldsFrom(std::string_view sessions, std::string_view terrains);

// Asks while the window stays responsive. Main thread only.
class WorldsQuestion {
 public:
  explicit WorldsQuestion(const core::Url& url);
  ~WorldsQuestion();  // gives up, within a tenth of a second but for the look-up of a host name
  WorldsQuestion(const WorldsQuestion&) = delete;
  // Returned once, when it is there. Error: the server's own sentence, or why there is none.
  std::optional<Outcome<Worlds>> take();

 private:
  std::stop_source stop_;
  std::future<Outcome<Worlds>> answer_;
};

}  // namespace ridgecast::viewer
