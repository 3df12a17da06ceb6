#pragma once
// The edits of one world in order, and the layer that they make on its terrain. The order is the truth: equal operations in equal order on
// an equal terrain make an equal layer on any machine, as if undone ones had never been made.
//
// Memory besides the layer: the packed edits (packed.h) and some 25 bytes each; kMaxCheckpointBytes. An undo starts from the latest
// checkpoint before the undone edit and replays the later edits that touch what the undo changes, on that ground alone. Checkpoints are
// layers; the further back, the fewer: at most two for each doubling of the work since. So an undo examines edits of at most about twice
// the work done since the undone edit, unless wide edits fill kMaxCheckpointBytes: then the largest checkpoints are dropped. After
// restore() there are none before the restored layer.
//
// One thread at a time; layers, once taken, may be read by any. Bounds: kMaxEdits operations, kMaxLayerBytes of layer. Running out of
// memory throws and changes nothing.

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/edits/area_index.h"
#include "common/edits/entries.h"
#include "common/edits/layer.h"
#include "common/edits/operation.h"
#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"
#include "common/outcome/turns.h"
#include "common/terrain/terrain.h"

namespace ridgecast::edits {

inline constexpr std::size_t kMaxEdits = 4'000'000;
inline constexpr std::size_t kMaxLayerBytes = std::size_t{512} << 20;
inline constexpr std::size_t kMaxCheckpointBytes = std::size_t{64} << 20;  // of all, not counting what they share
inline constexpr std::uint64_t kMaxUndoPosts = std::uint64_t{1} << 26;     // that a server looks at for one undo: about two seconds

class History {
 public:
  explicit History(std::shared_ptr<const terrain::Terrain> terrain, std::size_t mostBytes = kMaxLayerBytes);

  std::uint64_t last() const { return last_; }            // number of the last edit; 0: none
  std::uint64_t compacted() const { return compacted_; }  // those up to this number are permanently part of the ground
  const std::shared_ptr<const Layer>& layer() const { return layer_; }
  const std::shared_ptr<const terrain::Terrain>& terrain() const { return terrain_; }
  // Posts examined so far, weighted by effort; an undo replays edits.
  std::uint64_t looked() const { return looked_; }
  // Of edits that this has added or read.
  bool isUndone(std::uint64_t edit) const { return !counts(edit); }
  Operation operation(std::uint64_t edit) const;
  std::string_view packed(std::uint64_t edit) const { return entries_.packed(indexOf(edit)); }  // until the next edit
  std::size_t checkpointBytes() const;  // of layers that are held for undos, unshared

  // The operation as it is stored: checked, and a road without heights surveyed on the current ground. Error: why not. make() does this
  // too.
  Outcome<Operation> prepare(Operation operation);

  // An edit in progress, in turns. Until it is done the history is unchanged; destroying this abandons it. Meanwhile the history must not
  // move, and no other edit may be made or taken back.
  class Making {
   public:
    // Examines about `posts` more posts, at least one. True: done; do not call again.
    bool step(std::uint64_t posts);
    // Once done: a rectangle around the posts whose height or material changed. Error: not a valid edit, no room, or an undo that would
    // examine too many posts; nothing has changed then.
    const Outcome<Posts>& result() const { return *result_; }

   private:
    friend History;
    std::unique_ptr<Outcome<Posts>> result_;
    Turns turns_;
    Making(std::unique_ptr<Outcome<Posts>> result, Turns turns) : result_(std::move(result)), turns_(std::move(turns)) {}
  };
  // The next edit. `mostUndoPosts`: an undo that must examine more is refused before it begins. Callers that replay others' edits set no
  // limit.
  Making make(Operation operation, std::uint64_t mostUndoPosts = std::numeric_limits<std::uint64_t>::max());
  Outcome<Posts> add(Operation operation);  // the same, to completion

  // The last edit was not kept after all: everything is as before it, when the layer was `before`.
  void takeBack(std::shared_ptr<const Layer> before);

  // Restores an earlier history's final state, its last number and layer; operations are loaded lazily, on the first undo, some at a time.
  struct Past {
    std::shared_ptr<const Layer> base;  // what the compacted edits have made
    std::vector<Operation> operations;  // at least one while there are more, up to `last`
  };
  // The edits after `after`; the base is required with those after the last compacted one, even if there are none.
  using Read = std::function<Outcome<Past>(std::uint64_t after)>;
  void restore(std::uint64_t compacted, std::uint64_t last, std::shared_ptr<const Layer> layer, Read read);

  // Recomputes the layer from the past, whatever it was. Error: that cannot be read, or undoes a missing edit.
  Outcome<void> replay();

 private:
  struct Checkpoint {
    std::uint64_t edit = 0, work = 0;  // the state after this edit, and the work until then
    std::shared_ptr<const Layer> layer;
    std::size_t bytes = 0;  // not shared with the next one, or the layer
  };
  // What an edit changes in the history.
  struct Made {
    std::shared_ptr<const Layer> layer;
    std::vector<Checkpoint> checkpoints;  // of an undo
    Posts changed;
  };
  // What an undo is about: the ground of `edit`.
  struct Undoing {
    std::uint64_t mostPosts = 0;
    std::uint64_t edit = 0;            // 0: of none
    std::uint64_t from = 0;            // the checkpoint's edit
    TileSet changed, needed;           // tiles that may change, and those that this depends on
    std::vector<std::uint32_t> again;  // the edits to replay, counted from `compacted_`
    std::uint64_t cost = 0;            // posts, of finding these and of what is to come
  };
  std::size_t indexOf(std::uint64_t edit) const {
    expects(edit > last_ - entries_.size() && edit <= last_, "an edit that is asked for is in the history");
    return edit - 1 - (last_ - entries_.size());
  }
  bool counts(std::uint64_t edit) const { return entries_.undos(indexOf(edit)) == 0; }
  Turns making(Operation operation, std::uint64_t mostUndoPosts, Outcome<Posts>& result);
  Turns preparing(Operation& operation, Outcome<void>& fits);
  Turns reading(Outcome<void>& done);
  Outcome<void> addPast(const std::vector<Operation>& operations);
  void joinPast();
  // Adds `more` to the undos of this edit that count. Returns the edit whose ground changes; 0: none, as others count as well.
  std::uint64_t addUndos(std::uint64_t edit, int more);
  Turns undoing(std::uint64_t edit, std::uint64_t mostPosts, Made& made, Outcome<void>& fits);
  Turns findGround(std::uint64_t edit, Undoing& undo) const;  // as addUndos(edit, 1), without changes
  // Whether an edit counts after the undo.
  bool countsAfter(const Undoing& undo, std::uint64_t edit) const { return counts(edit) != (edit == undo.edit); }
  // Adds the smoothings between two edits whose areas meet the posts. Returns what it cost.
  std::uint64_t addSmooths(const Posts& where, std::uint64_t after, std::uint64_t before, const Undoing& undo,
                           std::set<std::uint32_t>& to) const;
  Turns findChanged(Undoing& undo, Posts& changed) const;
  Turns findNeeded(Undoing& undo) const;
  Turns findAgain(Undoing& undo) const;
  Turns makeAgain(const Undoing& undo, Made& made);
  void commit(const Operation& operation, Made made);
  bool isTimeForCheckpoint() const;
  void addCheckpoint(std::uint64_t edit);
  void weighCheckpoint(std::size_t k);
  void dropCheckpoint(std::size_t k);
  void boundCheckpoints(std::size_t from);  // those from there on have changed
  AreaIndex& indexFor(const Operation& operation) { return marginOf(operation) > 0 ? smooths_ : others_; }
  void file(std::uint64_t edit, const Operation& operation);

  std::shared_ptr<const terrain::Terrain> terrain_;
  std::size_t mostBytes_;
  std::uint64_t compacted_ = 0, last_ = 0;
  std::uint64_t looked_ = 0, work_ = 0;  // work: posts, not counting undos, and something for each edit
  Read read_;                            // the past before entries_; empty: entries_ and base_ have all
  Entries past_;                         // its first ones, as far as read
  Entries entries_;                      // the newest, up to last_
  AreaIndex smooths_, others_;           // of past_ and entries_, counted from compacted_
  std::shared_ptr<const Layer> base_ = std::make_shared<const Layer>(), layer_ = base_;
  std::vector<Checkpoint> checkpoints_;  // ascending; each as if what is undone had never been
};

}  // namespace ridgecast::edits
