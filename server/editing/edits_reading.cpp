// Reads of edits that are kept (edits.h), on the disk's thread.

#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "server/editing/edits.h"

namespace ridgecast::editing {

void Edits::read(std::uint64_t after, std::size_t most, Read read) {
  expects(read != nullptr, "what is read goes to somebody");
  const std::lock_guard lock(mutex_);
  if (readings_.empty()) disk_->post([self = shared_from_this()] { self->readAll(); });
  readings_.push_back({after, most, std::move(read)});
}

void Edits::copy(std::size_t most, std::function<void(Outcome<std::string>)> take) {
  expects(take != nullptr, "a copy goes to somebody");
  const bool posted = disk_->post([self = shared_from_this(), most, take] {
    if (!self->kept_.makeStore) return take(over().error());
    if (!self->kept_.store) return take(Error{"This session has no edits yet."});
    take(self->kept_.store->copy(most));
  });
  if (!posted) take(Error{"Too much waits for the disk; ask again in a moment."});
}

void Edits::readAll() {
  std::vector<Reading> readings;
  std::uint64_t last = 0;
  {
    const std::lock_guard lock(mutex_);
    readings.swap(readings_);
    last = ground_.edit;
  }
  for (const Reading& r : readings) {
    if (!kept_.makeStore) {
      r.read(over().error());
    } else if (!kept_.store) {
      r.read(std::vector<Applied>());
    } else {
      auto edits = kept_.store->read(r.after, r.most);
      if (!edits) {
        r.read(told(edits.error()));
        continue;
      }
      while (!edits->empty() && edits->back().number > last) edits->pop_back();  // kept, and not in the ground yet
      r.read(std::move(edits));
    }
  }
}

}  // namespace ridgecast::editing
