#pragma once
// The edits of one world in their order, and the layer that they make on its terrain. The order is the truth: equal operations in equal
// order on an equal terrain make an equal layer, whoever computes it, with undone ones left out as if they had never been.
//
// One thread at a time; layers, once taken, may be read by any. Bound: kMostEdits operations, kMostLayerBytes of layer.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/edits/layer.h"
#include "common/edits/operation.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"

namespace ridgecast::edits {

inline constexpr std::size_t kMostEdits = 4'000'000;
inline constexpr std::size_t kMostLayerBytes = std::size_t{512} << 20;

class History {
 public:
  explicit History(std::shared_ptr<const terrain::Terrain> terrain, std::size_t mostBytes = kMostLayerBytes);

  std::uint64_t last() const { return last_; }            // number of the last edit; 0: none
  std::uint64_t compacted() const { return compacted_; }  // those up to this number are a part of the ground for good
  const std::shared_ptr<const Layer>& layer() const { return layer_; }
  const std::shared_ptr<const terrain::Terrain>& terrain() const { return terrain_; }
  // Posts looked at so far, weighed by their effort; an undo makes edits again.
  std::uint64_t looked() const { return looked_; }
  // Of edits that this has added or read.
  bool isUndone(std::uint64_t edit) const { return !entry(edit).counts(); }
  const Operation& operation(std::uint64_t edit) const { return entry(edit).operation; }

  // The operation as it is kept: checked, and a road that has no heights yet surveyed on the ground there is now. Error: why not.
  Outcome<Operation> prepare(Operation operation);

  // The next edit, prepared. Returns the posts whose height or material changed (a rectangle around them). Error: no room; nothing has
  // changed then.
  Outcome<Posts> add(Operation operation);

  // The last edit was not kept after all: everything is as before it, when the layer was `before`.
  void takeBack(std::shared_ptr<const Layer> before);

  // Goes on from an earlier history's end: its last number and its layer. What made it is read when an edit is undone, and not before.
  struct Past {
    std::shared_ptr<const Layer> base;  // what the compacted edits have made
    std::vector<Operation> operations;  // those after them, up to `last`
  };
  using Read = std::function<Outcome<Past>()>;
  void restore(std::uint64_t compacted, std::uint64_t last, std::shared_ptr<const Layer> layer, Read read);

  // Makes the layer again, whatever it was, from the past. Error: it cannot be read, or undoes what is not there.
  Outcome<void> replay();

 private:
  struct Entry {
    Operation operation;
    Posts area;
    int undos = 0;  // that count, of this one
    bool counts() const { return undos == 0; }
  };
  // The tiles that an operation changes, on a layer; `within`: those alone, null: all.
  std::vector<Layer::Change> changesOf(const Operation& operation, const Layer& on, const TileSet* within) const;
  std::vector<Layer::Change> smoothed(const Operation& operation, const Layer& on, const TileSet* within) const;
  std::size_t indexOf(std::uint64_t edit) const { return edit - 1 - (last_ - entries_.size()); }
  const Entry& entry(std::uint64_t edit) const { return entries_[indexOf(edit)]; }
  Outcome<void> readAll();
  // One undo of this edit more or less counts. Returns the edit whose ground that is about; 0: none, for others count as well.
  std::uint64_t addUndos(std::uint64_t edit, int more);
  // The layer as it is after `edit` counts, or no longer.
  std::shared_ptr<const Layer> replayed(std::uint64_t edit) const;

  std::shared_ptr<const terrain::Terrain> terrain_;
  std::size_t mostBytes_;
  std::uint64_t compacted_ = 0, last_ = 0;
  mutable std::uint64_t looked_ = 0;
  Read read_;                   // the past before entries_; empty: entries_ and base_ have all
  std::vector<Entry> entries_;  // the newest, up to last_
  std::shared_ptr<const Layer> base_ = std::make_shared<const Layer>(), layer_ = base_;
};

}  // namespace ridgecast::edits
