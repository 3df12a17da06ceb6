// What a camera's client asks and hears of edits.
#include <chrono>
#include <memory>
#include <string>
#include <utility>

#include "common/edits/author.h"
#include "common/edits/edited_terrain.h"
#include "common/edits/json.h"
#include "common/edits/square.h"
#include "common/outcome/contract.h"
#include "server/member/camera_session.h"

namespace ridgecast::member {

namespace {

using wire::ErrorCode;
using wire::ErrorMessage;

static_assert(edits::kMaxAuthorBytes == wire::kMaxNameBytes);

constexpr std::chrono::milliseconds kEditPause{5};  // between two messages about edits

}  // namespace

CameraSession::Refusal CameraSession::attend(const wire::Edit& edit) {
  constexpr std::size_t kArrived = 2;  // answers that the client may have before their tickets are released here
  if (*openEdits_ >= wire::kMaxEdits + kArrived)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(wire::kMaxEdits) +
                                               " edits wait for their answers: send the next when one has arrived."};
  ++*openEdits_;
  const auto answer = [sender = sender_, open = openEdits_, id = edit.id](const Outcome<std::uint64_t>& number) {
    sender->send(number ? wire::EditAnswer{id, *number, {}} : wire::EditAnswer{id, 0, number.error().message},
                 conversation::ticketOf(open));
  };
  auto operation = edits::fromJson(edit.operation);
  if (!session_->resources().limits.takesEdits) {
    answer(Error{"This session plays a recording; its ground changes as it was recorded."});
  } else if (!operation) {
    answer(operation.error());
  } else {
    std::string author = edits::toText({membership_.client, conversation_.hello().clientName});
    session_->edit({edit.key, std::move(author), std::move(*operation)}, membership_.budgets, answer);
  }
  return {};
}

void CameraSession::groundChanged() {
  const std::lock_guard lock(mutex_);
  if (!conversation_.runs()) return;
  conversation_.groundChanged();
  tellEdits();
  wake();
}

void CameraSession::tellEdits() {
  if (!conversation_.runs() || !conversation_.hello().edits || news_.isOnItsWay) return;
  if (news_.told >= session_->ground().edit) return;
  news_.isOnItsWay = true;
  session_->editPages().page(news_.told, [weak = weak_from_this()](const Outcome<editing::EditPages::Page>& page) {
    if (const auto self = weak.lock()) self->tell(page);
  });
}

void CameraSession::tell(const Outcome<editing::EditPages::Page>& page) {
  const std::lock_guard lock(mutex_);
  if (!page) return refuse({ErrorCode::kInternal, page.error().message});
  if (!conversation_.runs()) return;
  if (page->message) {
    expects(page->last > news_.told, "a page goes on where the last one ended");
    news_.told = page->last;
    const auto held = std::make_shared<char>();
    news_.page = held;
    conversation_.sent(page->message->size(), session_->resources().timer->now());
    sender_->sendShared(page->message, held);
  }
  tellSoon(kEditPause);
}

// The next page, when the last has left: one at most waits for a client that does not read.
void CameraSession::tellSoon(std::chrono::milliseconds pause) {
  const scheduling::Timer& timer = *session_->resources().timer;
  news_.alarm.set(timer, timer.now() + pause, weak_from_this(), mutex_, &CameraSession::tellNext);
}

void CameraSession::tellNext() {
  if (!conversation_.runs()) return;
  const bool isSlow = !news_.page.expired() || sender_->queuedBytes() > session_->resources().limits.maxQueuedBytes;
  if (isSlow) return tellSoon(kQueueRetry);
  news_.isOnItsWay = false;
  tellEdits();
}

void CameraSession::work(const wire::FindEdits& find) {
  auto [ground, changed] = session_->edits().since(find.since);
  wire::FoundEdits message{ground.edit, std::move(changed), {}};
  if (const auto layer = edits::layerOf(*ground.terrain); layer && find.radius > 0)
    message.squares = edits::squaresAround(*layer, find.at, find.radius, wire::kMaxFoundSquares);
  {
    const std::lock_guard lock(mutex_);
    conversation_.sent(12 * message.squares.size() + 32 * message.changed.size(), session_->resources().timer->now());
  }
  sender_->send(std::move(message));
}

void CameraSession::work(const conversation::SendSquares& wanted) {
  const auto ground = session_->ground();
  const auto layer = edits::layerOf(*ground.terrain);
  wire::Squares message{ground.edit, {}};
  std::size_t bytes = 0;
  for (const terrain::TileAddress address : wanted.squares) {
    edits::SquareBytes square = layer ? edits::encode(edits::squareOf(*layer, address)) : edits::SquareBytes();
    bytes += square.rises.size() + square.materials.size() + 16;
    message.squares.push_back({address, std::move(square.rises), std::move(square.materials)});
  }
  {
    const std::lock_guard lock(mutex_);
    conversation_.sent(bytes, session_->resources().timer->now());
  }
  sender_->send(std::move(message));
}

}  // namespace ridgecast::member
