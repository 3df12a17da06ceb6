#include "server/editing/edit_pages.h"

#include <new>

#include "common/edits/author.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::editing {

namespace {

Outcome<EditPages::Page> pageOf(const std::vector<Applied>& edits) {
  wire::Edited message;
  std::size_t bytes = 0;
  for (const Applied& made : edits) {
    const auto operation = edits::unpack(made.operation);
    if (!operation) return operation.error();
    std::string json = edits::toJson(*operation);
    bytes += json.size();
    if (!message.edits.empty() && (bytes > EditPages::kMaxBytes || message.edits.size() == wire::kMaxMadeEdits)) break;
    edits::Author author = edits::authorOf(made.author);
    message.edits.push_back({made.number, std::move(author.client), std::move(author.name), std::move(json), made.ground});
  }
  if (message.edits.empty()) return EditPages::Page{};
  const std::uint64_t last = message.edits.back().number;
  return EditPages::Page{std::make_shared<const std::string>(wire::encode(wire::ServerMessage(std::move(message)))), last};
}

}  // namespace

void EditPages::page(std::uint64_t after, Take take) {
  expects(take != nullptr, "a page goes to somebody");
  {
    const std::lock_guard lock(mutex_);
    auto& takers = asked_[after];
    takers.push_back(std::move(take));
    if (takers.size() > 1) return;
    for (const Coded& coded : coded_)
      if (auto message = coded.message.lock(); message && coded.after == after)
        return answer({after, Page{std::move(message), coded.last}, {}});
  }
  edits_->read(after, kMaxKeptBytes, [weak = weak_from_this(), after](Outcome<std::vector<Applied>> edits) {
    const auto self = weak.lock();
    if (!self) return;
    const std::lock_guard lock(self->mutex_);
    self->answer({after, {}, std::move(edits)});
  });
}

void EditPages::answer(Read read) {
  if (read_.empty()) pool_->post([self = shared_from_this()] { self->code(); });
  read_.push_back(std::move(read));
}

void EditPages::code() {
  std::unique_lock lock(mutex_);
  expects(!read_.empty(), "a page that is coded was read");
  const Read read = std::move(read_.front());
  lock.unlock();
  Outcome<Page> page = Error{"The server ran out of memory at a page of edits; connect again."};
  try {
    page = read.page ? *read.page : read.edits ? pageOf(*read.edits) : read.edits.error();
  } catch (const std::bad_alloc&) {  // as it says
  }
  lock.lock();
  expects(asked_.contains(read.after), "a page that is read was asked for");
  const std::vector<Take> takers = std::move(asked_.extract(read.after).mapped());
  expects(!page || !page->message || page->last > read.after, "a page goes on after the edit that was named");
  if (page && page->message && !read.page) {
    coded_.push_back({read.after, page->last, page->message});
    if (coded_.size() > kRecent) coded_.pop_front();
  }
  read_.pop_front();
  if (!read_.empty()) pool_->post([self = shared_from_this()] { self->code(); });
  lock.unlock();
  for (const Take& take : takers) take(page);
}

}  // namespace ridgecast::editing
