#pragma once
// The two pictures of the window, mesh and ray march, and how they share it. Draws only what has changed. Main thread only.

#include <chrono>
#include <filesystem>
#include <optional>
#include <tuple>

#include "client/viewer/panes.h"
#include "client/viewer/stream.h"

namespace ridgecast::viewer {

class Pictures {
 public:
  explicit Pictures(Passes passes) : passes_(std::move(passes)) {}
  Pictures(const Pictures&) = delete;
  // Brings up to date what the mode shows. Returns whether there is something new. `newHeights`: the heights below the view have changed.
  // Error: the window is larger than the driver can draw.
  Outcome<bool> update(const render::View& view, const Stream& stream, ViewerState& state, bool newHeights);
  // Whether an update with nothing new would draw finer.
  bool refining(Mode mode) const { return mode != Mode::kMesh && !march_.isFinest(); }
  // Whether the pictures shown are final.
  bool finished(const ViewerState& state) const;
  // Into the window's framebuffer, which is of this size and bound afterwards.
  void present(int width, int height, const ViewerState& state);

 private:
  render::Structure structure(const Stream& stream, const ViewerState& state) const;
  Passes passes_;
  MeshPane mesh_{passes_};
  MarchPane march_{passes_};
  bool meshStale_ = false, marchStale_ = false;
  std::optional<camera::Camera> drawn_;
  // What the lines over the mesh were made from: difference, wireframe, borders, frozen, candidates, scene.
  using Structured = std::tuple<bool, bool, Borders, std::optional<camera::Camera>, Stream::Candidates, std::uint64_t>;
  std::optional<Structured> structuredAs_;
  std::chrono::steady_clock::time_point structured_{};
};

// Writes the window's framebuffer as PNG.
Outcome<void> saveWindow(int width, int height, const std::filesystem::path& file);

}  // namespace ridgecast::viewer
