#include "server/bus/brief_records.h"

#include <iterator>
#include <utility>

namespace ridgecast::bus {

void BriefRecords::hold(const std::shared_ptr<Bus>& bus, const std::string& key, std::string value, Time now,
                        std::function<void(Outcome<Bus::Held>)> done) {
  const std::size_t bytes = key.size() + value.size();
  {
    const std::lock_guard lock(mutex_);
    if (now >= until_ && !isClaiming_) {
      until_ = now + kLife;
      left_ = taken_ = 0;
    }
    if (bytes <= shareBytes_ && taken_ + bytes <= kSharesOfOne * shareBytes_) {
      taken_ += bytes;
      waiting_.push_back({bytes, [bus, key, value = std::make_shared<std::string>(std::move(value)), done](bool hasRoom) {
                            if (!hasRoom) return done(Error{"The engine has no room for more such records now; try again in a minute."});
                            bus->hold(key, std::move(*value), 0, kLife, done);
                          }});
      done = nullptr;
    }
  }
  if (done) return done(Error{"This server has written too many such records within a minute."});
  serve(bus);
}

void BriefRecords::serve(const std::shared_ptr<Bus>& bus) {
  std::vector<Waiting> served;
  bool claims = false;
  {
    const std::lock_guard lock(mutex_);
    auto next = waiting_.begin();
    for (; next != waiting_.end() && next->bytes <= left_; ++next) left_ -= next->bytes;
    served.assign(std::make_move_iterator(waiting_.begin()), std::make_move_iterator(next));
    waiting_.erase(waiting_.begin(), next);
    claims = !waiting_.empty() && !std::exchange(isClaiming_, true);
  }
  for (const Waiting& w : served) w.go(true);
  if (claims) claim(bus, 0);
}

void BriefRecords::claim(const std::shared_ptr<Bus>& bus, int share) {
  bus->hold("share/" + name_ + "/" + std::to_string(share), std::to_string(bus->server()), 0, 2 * kLife + kDelay,
            [weak = weak_from_this(), engine = std::weak_ptr(bus), share](const Outcome<Bus::Held>& held) {
              const auto self = weak.lock();
              const auto there = engine.lock();
              if (!self || !there) return;
              if (held && !held->isYours && share + 1 < kShares) return self->claim(there, share + 1);
              self->claimed(there, held && held->isYours);
            });
}

void BriefRecords::claimed(const std::shared_ptr<Bus>& bus, bool isOurs) {
  std::vector<Waiting> refused;
  {
    const std::lock_guard lock(mutex_);
    isClaiming_ = false;
    if (isOurs)
      left_ = shareBytes_;  // what is left of the one before is less than one record
    else
      refused.swap(waiting_);
    for (const Waiting& w : refused) taken_ -= w.bytes;
  }
  for (const Waiting& w : refused) w.go(false);
  if (isOurs) serve(bus);
}

}  // namespace ridgecast::bus
