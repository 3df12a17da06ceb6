#include "server/clock/messages.h"

#include <chrono>
#include <utility>

#include "common/codec/fields.h"

namespace ridgecast::clock {

namespace {

template <class Io>
bool set(Io& io, auto& v) {
  std::uint64_t count = v.size(), last = 0;
  if (!io(count)) return false;
  if constexpr (!Io::kWrites) {
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

bool notNegative(auto& io, auto& rate) { return io(rate) && rate >= 0; }

bool fieldsOf(auto& io, auto& step) requires requires { step.wait; }
{ return io.upTo(step.time, wire::kMaxStepTime) && io(step.wait); }

constexpr std::uint64_t kMaxMode = 2;

template <class Io>
bool clockFields(Io& io, auto& clock) {
  using namespace std::chrono;
  Clock::State all = clock.all();
  auto since = static_cast<std::uint64_t>(duration_cast<microseconds>(all.since.time_since_epoch()).count());
  if (!io.upTo(since, wire::kMaxTime)) return false;
  all.since = Clock::Instant(microseconds(since));
  if (!io.upTo(all.time, wire::kMaxTime) || !io.upTo(all.mode, kMaxMode) || !notNegative(io, all.rate) || !io(all.owner) || !io(all.step) ||
      !set(io, all.followers) || !set(io, all.waitsFor) || !set(io, all.passedOver) ||
      !io.list(all.queued, [&](auto& step) { return fieldsOf(io, step); }))
    return false;
  if (all.queued.size() > Clock::kMaxQueuedSteps || (!all.queued.empty() && all.mode != wire::ClockMode::kStepped)) return false;
  if constexpr (!Io::kWrites) clock = Clock(std::move(all));
  return true;
}

template <class Io>
bool recordFields(Io& io, auto& record) {
  if (!io(record.version) || !io(record.changes) || !clockFields(io, record.clock)) return false;
  std::uint64_t count = record.servers.size();
  if (!io(count)) return false;
  if constexpr (!Io::kWrites) {
    for (; count > 0; --count) {
      std::uint32_t server = 0;
      Record::Server one;
      if (!io(server) || !io(one.applied) || !io(one.isHere) || !set(io, one.members)) return false;
      record.servers[server] = std::move(one);
    }
  } else {
    for (auto& [server, one] : record.servers) io(server), io(one.applied), io(one.isHere), set(io, one.members);
  }
  return true;
}

bool callFields(auto& io, auto& call) {
  if (!io.upTo(call.kind, static_cast<std::uint64_t>(Call::Kind::kReach)) || !io(call.member)) return false;
  switch (call.kind) {
    case Call::Kind::kFollow:
    case Call::Kind::kLeave:
      return true;
    case Call::Kind::kSet:
      return io(call.set.own) && io.upTo(call.set.mode, kMaxMode) && notNegative(io, call.set.rate) &&
             io.upTo(call.set.time, wire::kMaxTime);
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
  return io(told.epoch) && io(told.isLast) && recordFields(io, told.record) &&
         io.list(told.notices, [&](auto& notice) { return io(notice.member) && io(notice.sentence) && io(notice.isRefusal); });
}

template <class Io>
bool numberedFields(Io& io, auto& numbered) {
  bool isAll = numbered.all.has_value();
  if (!io(numbered.number) || !io(isAll)) return false;
  if (!isAll) return callFields(io, numbered.call);
  if constexpr (!Io::kWrites) numbered.all.emplace();
  return io.list(*numbered.all, [&](auto& member) { return io(member.member) && io(member.follows); });
}

bool fieldsOf(auto& io, auto& told) requires requires { told.calls; }
{
  return io(told.server) && io(told.isLast) && io.list(told.calls, [&](auto& numbered) { return numberedFields(io, numbered); });
}

template <class T>
std::string written(const T& value) {
  std::vector<std::uint8_t> bytes;
  codec::FieldWriter out(bytes);
  out(std::uint64_t{kFormat});
  fieldsOf(out, value);
  return {bytes.begin(), bytes.end()};
}

template <class T>
Outcome<T> read(const std::string& bytes) {
  codec::FieldReader in({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  std::uint64_t format = 0;
  T value;
  if (in(format) && format == kFormat && fieldsOf(in, value) && in.isOver()) return value;
  return Error{"What another server says of the clock has another format than this server's; servers of one world have the same version."};
}

}  // namespace

std::string toBytes(const Record& record) { return written(record); }
std::string toBytes(const Told& told) { return written(told); }
std::string toBytes(const ToldCalls& calls) { return written(calls); }

Outcome<Record> recordOf(const std::string& bytes) { return read<Record>(bytes); }
Outcome<Told> toldOf(const std::string& bytes) { return read<Told>(bytes); }
Outcome<ToldCalls> toldCallsOf(const std::string& bytes) { return read<ToldCalls>(bytes); }

}  // namespace ridgecast::clock
