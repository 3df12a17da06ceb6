#pragma once
// A user's editing, in window and page: the brush and its radius, the corners of a road, unanswered edits (also a program's), and what
// may be undone. An unanswered edit is resent over the next connection; its key ensures that it is made once. Values only. Bounds:
// kMaxCorners corners, kMaxOpen unanswered edits of the user, kMaxWaiting with a program's, kMaxUndone to undo.

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/edits/operation.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

enum class Tool { kCrater, kRaise, kLower, kLevel, kSmooth, kRoad };
inline constexpr std::array<const char*, 6> kToolNames{"Crater", "Raise", "Lower", "Level", "Smooth", "Road"};

std::string randomKey();  // globally unique

class Editing {
 public:
  static constexpr std::size_t kMaxOpen = 16, kMaxWaiting = 256, kMaxUndone = 1024;
  static constexpr int kMaxTimes = 3;  // that an edit is sent

  struct To {
    std::function<void(const wire::Edit& edit)> send;  // may call hear() before it returns
    std::function<void(const std::string& sentence)> say;
    std::function<std::string()> newKey = randomKey;
  };
  explicit Editing(To to) : to_(std::move(to)) {}
  using Done = std::function<void(const Outcome<std::uint64_t>& made)>;

  Tool tool() const { return tool_; }
  std::uint32_t material() const { return material_; }
  lattice::Step radius() const { return radius_; }                          // of a road: half its width
  const std::vector<lattice::Vertex>& corners() const { return corners_; }  // of a road that is being drawn
  bool mayUndo() const { return !corners_.empty() || !made_.empty(); }
  std::string words() const;  // what the brush does where it is used

  void choose(Tool tool);
  void paint(std::uint32_t material) { material_ = material; }  // of edits::Operation
  void widen(double notches);
  void rest() { corners_.clear(); }  // leaves a road that was begun

  void use(const lattice::Vertex& at);
  void endRoad();
  // Undoes the last corner of a road being drawn, otherwise the user's last edit that still counts.
  void undo();

  // A program's edit (common/edits/json.h). `done` is called once, where the user would be told, and the edit is not the user's to undo.
  void make(std::string operation, Done done);

  // The answer to what was sent with this id: the edit's number, or why there is none.
  void hear(std::uint64_t id, const Outcome<std::uint64_t>& made);
  // Another connection has begun, to the same world.
  void connected();
  // The client is in another session now: a program hears that its edits have no answer. Nothing else may be called after this.
  void leave();

 private:
  struct Open {
    wire::Edit edit;
    std::uint64_t undoes = 0;  // 0: it is no undo
    Done done{};               // of a program's
    int times = 1;
  };
  edits::Operation operationAt(const lattice::Vertex& at) const;
  std::int32_t depth() const;
  std::int32_t rise() const;
  void undoEdit();
  bool ask(const edits::Operation& operation, std::uint64_t undoes = 0);
  void send(std::string operation, std::uint64_t undoes, Done done);
  void keep(std::uint64_t number);

  const To to_;
  Tool tool_ = Tool::kCrater;
  std::uint32_t material_ = 0;
  lattice::Step radius_ = 8 * 256;
  std::vector<lattice::Vertex> corners_;
  std::vector<Open> open_;
  std::vector<std::uint64_t> made_;  // ascending; one undone by another member is noticed when its turn comes
  std::uint64_t ids_ = 0;
};

}  // namespace ridgecast::core
