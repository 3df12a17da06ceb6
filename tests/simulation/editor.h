#pragma once
// What a member does to the ground, over all its connections: it asks for edits, repeats those with a key whose answer was lost, undoes,
// and follows everybody's.

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "common/edits/operation.h"
#include "common/wire/messages.h"
#include "tests/simulation/server.h"
#include "tests/simulation/truth.h"

namespace ridgecast::simulation {

class Editor {
 public:
  using Answered = std::function<void(const Outcome<wire::EditAnswer>&)>;
  using Say = std::function<void(wire::Edit, Answered)>;
  Editor(std::string author, Truth& truth, Random& random) : author_(std::move(author)), truth_(truth), random_(random) {}

  void edit(lattice::Point near, const Say& say);
  void ask(edits::Operation operation, const Say& say);  // with a key
  void connected(const wire::World& world, const Say& say, bool mayBeBehind = false);
  void lost();  // the connection
  void take(const std::vector<wire::MadeEdit>& edits);
  void forget() { followed_ = 0; }  // what it followed

  bool hasRoom() const;
  bool waits() const { return !open_.empty(); }
  bool wasRefused() const { return wasRefused_; }  // the last one
  std::uint64_t followed() const { return followed_; }

 private:
  struct Request {
    Truth::Asked asked;
    std::uint64_t sent = 0;
    std::uint64_t known = 0, lostEnds = 0;  // to anybody, when it was asked
  };
  void send(Request request, const Say& say);
  void take(std::uint64_t id, const Outcome<wire::EditAnswer>& answer);

  const std::string author_;
  Truth& truth_;
  Random& random_;
  std::map<std::uint64_t, Request> open_;  // in order
  std::vector<Request> lost_;              // with their connection, before their answers came
  std::uint64_t ids_ = 0, keys_ = 0, followed_ = 0, known_ = 0;
  bool wasRefused_ = false;
};

}  // namespace ridgecast::simulation
