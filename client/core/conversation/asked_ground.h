#pragma once
// Tiles and squares of ground that were requested, and their answers until they are taken. Internal to the room.

#include <cstddef>
#include <iterator>
#include <utility>
#include <vector>

#include "client/core/conversation/outbox.h"
#include "common/outcome/contract.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

struct EditsFound {
  std::vector<wire::FoundEdits> found;
  std::vector<wire::Squares> squares;
};

class AskedGround {
 public:
  void asks(const wire::WantTiles& wanted) { tilesOpen_ += wanted.tiles.size(); }
  void asks(const wire::WantSquares& wanted) { squaresOpen_ += wanted.squares.size(); }
  void asks(const wire::FindEdits&) { ++findsOpen_; }

  Wrong hear(wire::HeightTiles&& come) {
    if (come.tiles.size() > tilesOpen_ - tiles_.size()) return "sent tiles of heights that were not requested";
    std::move(come.tiles.begin(), come.tiles.end(), std::back_inserter(tiles_));
    return std::nullopt;
  }
  Wrong hear(wire::Squares&& come) {
    if (come.squares.size() > squaresOpen_) return "sent squares of edits that were not requested";
    squaresOpen_ -= come.squares.size();
    found_.squares.push_back(std::move(come));
    return std::nullopt;
  }
  Wrong hear(wire::FoundEdits&& found) {
    if (findsOpen_ == 0) return "broke the protocol: where edits are, without being asked";
    --findsOpen_;
    found_.found.push_back(std::move(found));
    return std::nullopt;
  }

  bool hasCome() const { return !tiles_.empty() || !found_.found.empty() || !found_.squares.empty(); }
  std::vector<wire::HeightTile> takeTiles() {
    expects(tilesOpen_ >= tiles_.size(), "tiles come for those that are requested");
    tilesOpen_ -= tiles_.size();
    return std::exchange(tiles_, {});
  }
  EditsFound takeEdits() { return std::exchange(found_, {}); }

 private:
  std::size_t tilesOpen_ = 0, squaresOpen_ = 0, findsOpen_ = 0;  // requested and not taken; requested and not answered
  std::vector<wire::HeightTile> tiles_;
  EditsFound found_;
};

}  // namespace ridgecast::core
