#pragma once
// What the painter is told, and what it has not taken yet: changes never pile up there, because only taken ones are acknowledged.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client/core/ground/held_edits.h"
#include "client/core/mesh/scene.h"
#include "client/web/wasm/worker.h"
#include "common/edits/square.h"
#include "common/wire/messages.h"

namespace ridgecast::page {

inline std::string keyOf(const edits::SquareAddress& a) { return std::to_string(a.i) + "," + std::to_string(a.j); }
static_assert(sizeof(lattice::LeafAddress) == 24 && sizeof(core::PointMesh::Changed) == 64 && sizeof(mesh::LocalVertex) == 12);

class Painting {
 public:
  // What to acknowledge once a change is taken: over the line with this number.
  struct Taken {
    std::uint64_t line = 0;
    wire::Acknowledge acknowledge;
  };

  std::size_t changes() const { return changes_; }  // that were shown
  // The painter has taken its oldest untaken change.
  std::optional<Taken> taken() {
    if (untaken_.empty()) return std::nullopt;
    const auto taken = untaken_.front();
    untaken_.pop_front();
    return taken;
  }

  // The leaves that are gone, and those that the last iteration changed.
  void change(const core::Scene& scene, const std::vector<lattice::LeafAddress>& gone, bool clear, std::optional<Taken> taken = {}) {
    const std::vector<core::PointMesh::Changed>& fresh = scene.changed();
    scene.draw(drawing_);
    show(kind("change")("clear", clear),
         {{Array::kBytes, gone.data(), sizeof(lattice::LeafAddress) * gone.size()},
          {Array::kBytes, fresh.data(), sizeof(core::PointMesh::Changed) * fresh.size()},
          {Array::kUint32, drawing_.ends.data(), drawing_.ends.size()},
          {Array::kUint32, drawing_.blocks.data(), drawing_.blocks.size()},
          {Array::kUint32, drawing_.changed.data(), drawing_.changed.size()},
          {Array::kInt32, drawing_.corners.data(), 3 * drawing_.corners.size()}},
         taken);
  }

  void noCandidates() { paint(kind("candidates")); }
  // Of an iteration that has some.
  void candidates(const wire::Iteration& iteration) {
    const std::vector<lattice::Candidate>& all = *iteration.candidates;
    const lattice::Vertex from = all.empty() ? lattice::Vertex{} : all.front().at;
    std::vector<std::int32_t> points;
    std::vector<float> errors;
    for (const lattice::Candidate& c : all) {
      for (const lattice::Step v : {c.at.x - from.x, c.at.z - from.z, lattice::Step{c.at.y}})
        points.push_back(static_cast<std::int32_t>(v));
      errors.push_back(c.pixels);
    }
    paint(kind("candidates")("candidates",
                             Object()("x", from.x)("z", from.z)("threshold", std::max(iteration.figures.effectiveThreshold, 1e-3))),
          {{Array::kInt32, points.data(), points.size()}, {Array::kFloat32, errors.data(), errors.size()}});
  }

  // What has changed since the last time; null: no edits are held. Posts are 16 x their rise + their material.
  void squares(const core::HeldEdits* edits) {
    static const std::map<edits::SquareAddress, std::uint64_t> none;
    const auto& now = edits ? edits->squares() : none;
    List gone, fresh;
    std::vector<std::int32_t> posts;
    for (const auto& [address, version] : shown_)
      if (!now.contains(address)) gone(keyOf(address));
    for (const auto& [address, version] : now) {
      if (const auto before = shown_.find(address); before != shown_.end() && before->second == version) continue;
      const edits::Square square = edits::squareOf(*edits->layer(), address);
      const auto [lowest, highest] = std::ranges::minmax(square.rises);
      fresh(
          Object()("key", keyOf(address))("i", address.i)("j", address.j)("lowest", std::min(0, lowest))("highest", std::max(0, highest)));
      for (std::size_t k = 0; k < square.rises.size(); ++k) posts.push_back(16 * square.rises[k] + square.materials[k]);
    }
    const bool isNew = shown_ != now;
    shown_ = now;
    if (isNew) show(kind("squares")("gone", gone)("fresh", fresh), {{Array::kInt32, posts.data(), posts.size()}});
  }

 private:
  void show(const Object& change, const std::vector<Array>& arrays, std::optional<Taken> taken = {}) {
    untaken_.push_back(taken);
    ++changes_;
    paint(change, arrays);
  }

  std::size_t changes_ = 0;
  core::PointMesh::Drawing drawing_;
  std::map<edits::SquareAddress, std::uint64_t> shown_;
  std::deque<std::optional<Taken>> untaken_;  // as many as the server's window, and squares
};

}  // namespace ridgecast::page
