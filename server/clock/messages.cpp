#include "server/clock/messages.h"

#include <bit>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <span>
#include <type_traits>
#include <utility>

#include "common/codec/varint.h"

namespace ridgecast::clock {

// Private, under a name of its own: others in this room read and write, too.
namespace clock_bytes {
namespace {

// Both walk the same fields in the same order: fieldsOf describes each struct once. False: malformed.
class ClockWriter {
 public:
  static constexpr bool kReads = false;
  bool operator()(std::uint64_t v) { return codec::putVarint(bytes_, v), true; }
  bool operator()(double v) { return (*this)(std::bit_cast<std::uint64_t>(v)); }
  bool operator()(const std::string& v) {
    (*this)(std::uint64_t{v.size()});
    bytes_.insert(bytes_.end(), v.begin(), v.end());
    return true;
  }
  std::string take() const { return {bytes_.begin(), bytes_.end()}; }

 private:
  std::vector<std::uint8_t> bytes_;
};

class ClockReader {
 public:
  static constexpr bool kReads = true;
  explicit ClockReader(std::span<const std::uint8_t> bytes) : reader_(bytes) {}
  bool operator()(std::uint64_t& v) { return reader_.longVarint(v); }
  bool operator()(double& v) {
    std::uint64_t bits = 0;
    if (!(*this)(bits)) return false;
    v = std::bit_cast<double>(bits);
    return std::isfinite(v) && v >= 0;
  }
  bool operator()(std::string& v) {
    std::uint64_t size = 0;
    std::span<const std::uint8_t> bytes;
    if (!(*this)(size) || !reader_.bytes(size, bytes)) return false;
    v.assign(bytes.begin(), bytes.end());
    return true;
  }
  std::size_t left() const { return reader_.rest().size(); }

 private:
  codec::Reader reader_;
};

// `T` is const for a writer.
template <class T>
bool number(auto& io, T& v, std::uint64_t most) {
  auto wide = static_cast<std::uint64_t>(v);
  if (!io(wide) || wide > most) return false;
  if constexpr (!std::is_const_v<T>) v = static_cast<T>(wide);
  return true;
}

bool flag(auto& io, auto& v) { return number(io, v, 1); }

template <class Io>
bool set(Io& io, auto& v) {
  std::uint64_t count = v.size(), last = 0;
  if (!io(count)) return false;
  if constexpr (Io::kReads) {
    for (std::uint64_t step = 0; count > 0; --count) {
      if (!io(step) || (step == 0 && !v.empty())) return false;
      v.insert(v.end(), last += step);
    }
    return true;
  } else {
    for (const std::uint64_t one : v) io(one - std::exchange(last, one));
    return true;
  }
}

// Each takes a byte or more.
template <class Io>
bool list(Io& io, auto& v, auto&& each) {
  std::uint64_t count = v.size();
  if (!io(count)) return false;
  if constexpr (Io::kReads) {
    if (count > io.left()) return false;
    v.resize(count);
  }
  for (auto& one : v)
    if (!each(one)) return false;
  return true;
}

bool fieldsOf(auto& io, auto& step) requires requires { step.wait; }
{ return number(io, step.time, wire::kMaxStepTime) && flag(io, step.wait); }

constexpr std::uint64_t kMaxMode = 2;

template <class Io>
bool clockFields(Io& io, auto& clock) {
  using namespace std::chrono;
  Clock::State all = clock.all();
  auto since = static_cast<std::uint64_t>(duration_cast<microseconds>(all.since.time_since_epoch()).count());
  if (!number(io, since, wire::kMaxTime)) return false;
  all.since = Clock::Instant(microseconds(since));
  if (!number(io, all.time, wire::kMaxTime) || !number(io, all.mode, kMaxMode) || !io(all.rate) || !io(all.owner) || !io(all.step) ||
      !set(io, all.followers) || !set(io, all.waitsFor) || !set(io, all.passedOver) ||
      !list(io, all.queued, [&](auto& step) { return fieldsOf(io, step); }))
    return false;
  if (all.queued.size() > Clock::kMaxQueuedSteps || (!all.queued.empty() && all.mode != wire::ClockMode::kStepped)) return false;
  if constexpr (Io::kReads) clock = Clock(std::move(all));
  return true;
}

template <class Io>
bool recordFields(Io& io, auto& record) {
  if (!io(record.version) || !io(record.changes) || !clockFields(io, record.clock)) return false;
  std::uint64_t count = record.servers.size();
  if (!io(count)) return false;
  if constexpr (Io::kReads) {
    for (; count > 0; --count) {
      std::uint32_t server = 0;
      Record::Server one;
      if (!number(io, server, 0xffffffffu) || !io(one.applied) || !flag(io, one.isHere) || !set(io, one.members)) return false;
      record.servers[server] = std::move(one);
    }
  } else {
    for (auto& [server, one] : record.servers) number(io, server, 0xffffffffu), io(one.applied), flag(io, one.isHere), set(io, one.members);
  }
  return true;
}

bool callFields(auto& io, auto& call) {
  if (!number(io, call.kind, static_cast<std::uint64_t>(Call::Kind::kReach)) || !io(call.member)) return false;
  switch (call.kind) {
    case Call::Kind::kFollow:
    case Call::Kind::kLeave:
      return true;
    case Call::Kind::kSet:
      return flag(io, call.set.own) && number(io, call.set.mode, kMaxMode) && io(call.set.rate) &&
             number(io, call.set.time, wire::kMaxTime);
    case Call::Kind::kStep:
      return fieldsOf(io, call.step);
    case Call::Kind::kDone:
    case Call::Kind::kPassOver:
    case Call::Kind::kReach:
      return io(call.number);
  }
  return false;
}

bool fieldsOf(auto& io, auto& record) requires requires { record.servers; }
{ return recordFields(io, record); }

bool fieldsOf(auto& io, auto& told) requires requires { told.notices; }
{
  return io(told.epoch) && flag(io, told.isLast) && recordFields(io, told.record) &&
         list(io, told.notices, [&](auto& notice) { return io(notice.member) && io(notice.sentence); });
}

template <class Io>
bool numberedFields(Io& io, auto& numbered) {
  bool isAll = numbered.all.has_value();
  if (!io(numbered.number) || !flag(io, isAll)) return false;
  if (!isAll) return callFields(io, numbered.call);
  if constexpr (Io::kReads) numbered.all.emplace();
  return list(io, *numbered.all, [&](auto& member) { return io(member.member) && flag(io, member.follows); });
}

bool fieldsOf(auto& io, auto& told) requires requires { told.calls; }
{
  return number(io, told.server, 0xffffffffu) && flag(io, told.isLast) &&
         list(io, told.calls, [&](auto& numbered) { return numberedFields(io, numbered); });
}

template <class T>
std::string written(const T& value) {
  ClockWriter out;
  out(std::uint64_t{kFormat});
  fieldsOf(out, value);
  return out.take();
}

template <class T>
Outcome<T> read(const std::string& bytes) {
  ClockReader in({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  std::uint64_t format = 0;
  T value;
  if (in(format) && format == kFormat && fieldsOf(in, value) && in.left() == 0) return value;
  return Error{"What another server says of the clock has another format than this server's; servers of one world have the same version."};
}

}  // namespace
}  // namespace clock_bytes

std::string toBytes(const Record& record) { return clock_bytes::written(record); }
std::string toBytes(const Told& told) { return clock_bytes::written(told); }
std::string toBytes(const ToldCalls& calls) { return clock_bytes::written(calls); }

Outcome<Record> recordOf(const std::string& bytes) { return clock_bytes::read<Record>(bytes); }
Outcome<Told> toldOf(const std::string& bytes) { return clock_bytes::read<Told>(bytes); }
Outcome<ToldCalls> toldCallsOf(const std::string& bytes) { return clock_bytes::read<ToldCalls>(bytes); }

}  // namespace ridgecast::clock
