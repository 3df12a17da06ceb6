#include "server/recording/format.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <memory>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "common/codec/fields.h"
#include "common/codec/varint.h"

namespace ridgecast::recording {

namespace {

constexpr std::string_view kMagic = "ridgecast recording 1";

// Both walk the same fields in the same order: `walk` below describes each record once.
class Out : public codec::FieldWriter {
 public:
  using FieldWriter::FieldWriter;
  using FieldWriter::operator();
  template <class T>
  requires std::is_enum_v<T>
  bool operator()(const T& v) { return (*this)(static_cast<std::uint64_t>(v)); }
  // The bytes between the first and the last that differ from what was to be expected.
  bool near(const double& v, double expected) {
    const std::uint64_t differs = std::bit_cast<std::uint64_t>(v) ^ std::bit_cast<std::uint64_t>(expected);
    const int low = differs ? std::countr_zero(differs) / 8 : 0, count = differs ? 8 - std::countl_zero(differs) / 8 - low : 0;
    bytes_.push_back(static_cast<std::uint8_t>(low << 4 | count));
    return fixed(differs >> (8 * low), count);
  }
  template <std::integral T>
  bool near(const T& v, T expected) {
    return (*this)(static_cast<std::int64_t>(static_cast<std::uint64_t>(v) - static_cast<std::uint64_t>(expected)));
  }
};

class In : public codec::FieldReader {
 public:
  using FieldReader::FieldReader;
  using FieldReader::operator();
  template <class T>
  requires std::is_enum_v<T>
  bool operator()(T& v) { return upTo(v, std::is_same_v<T, wire::Metric> ? 3 : std::is_same_v<T, wire::ClockMode> ? 2 : 1); }
  bool near(double& v, double expected) {
    std::uint8_t where = 0;
    if (!reader_.byte(where)) return false;
    const int low = where >> 4, count = where & 15;
    std::uint64_t differs = 0;
    if (low + count > 8 || !fixed(differs, count)) return false;
    v = std::bit_cast<double>(std::bit_cast<std::uint64_t>(expected) ^ (count > 0 ? differs << (8 * low) : 0));
    return true;
  }
  template <std::integral T>
  bool near(T& v, T expected) {
    std::int64_t differs = 0;
    if (!(*this)(differs)) return false;
    v = static_cast<T>(static_cast<std::uint64_t>(differs) + static_cast<std::uint64_t>(expected));
    return true;
  }
};

template <class Walk, class Settings>
bool walkSettings(Walk& w, Settings& s) {
  return w(s.metric) && w(s.threshold) && w(s.triangleBudget) && w(s.bytesPerSecond) && w(s.candidates) && w(s.colourError);
}

// `e` is const where the walk writes.
template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, World>
bool walk(Walk& w, E& e, Known&) {
  std::string magic(kMagic);
  return w(magic) && magic == kMagic && w(e.session) && w(e.terrain) && w(e.seed) &&
         w.list(e.parameters, [&](auto& p) { return w(p.first) && w(p.second); }) && w.fixed(e.contentHash) && w(e.colours) &&
         w(e.server) && w(e.began);
}
template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, Joined>
bool walk(Walk& w, E& e, Known&) {
  return w(e.camera) && w(e.name) && w(e.role) && w(e.pacing) && walkSettings(w, e.granted) && w(e.edit) && w(e.again);
}
template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, Left>
bool walk(Walk& w, E& e, Known&) { return w(e.camera); }
template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, Edited>
bool walk(Walk& w, E& e, Known&) { return w(e.number) && w(e.author) && w(e.operation); }
template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, Clocked>
bool walk(Walk& w, E& e, Known&) { return w(e.mode) && w(e.rate) && w(e.time) && w(e.owner) && w(e.step); }
template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, Asked>
bool walk(Walk& w, E& e, Known&) { return w(e.camera) && w(e.places) && w(e.message); }

template <class Walk, class E>
requires std::is_same_v<std::remove_const_t<E>, EditsBefore>
bool walk(Walk& w, E& e, Known&) { return w(e.number); }

// Which of an iteration's fields are others than those known.
enum : std::uint32_t { kView = 1, kProjection = 2, kGranted = 4, kInsertions = 8, kEdit = 16, kSettled = 32, kHash = 64, kAllFlags = 127 };

// To the bit: -0 is not 0.
bool isSame(const camera::Pose& a, const camera::Pose& b) {
  const auto bits = [](const camera::Pose& p) { return std::bit_cast<std::array<std::uint64_t, 3>>(std::array{p.y, p.yaw, p.pitch}); };
  return a.x == b.x && a.z == b.z && bits(a) == bits(b);
}

std::uint32_t flagsOf(const Iterated& e, const Known& known) {
  return (isSame(e.view.pose, known.last.pose) && e.pose == known.pose ? 0u : kView) |
         (e.view.projection == known.last.projection ? 0u : kProjection) | (e.granted ? kGranted : 0u) |
         (e.insertions == known.insertions ? 0u : kInsertions) | (e.edit == known.edit && e.changed.empty() ? 0u : kEdit) |
         (e.settled ? kSettled : 0u) | (e.hash == known.hash ? 0u : kHash);
}

bool isOnLattice(const lattice::Area& a) {
  constexpr lattice::Step kMax = 2 * lattice::kMaxPosition;
  return std::ranges::all_of(std::array{a.x0, a.z0, a.x1, a.z1}, [](lattice::Step s) { return s >= -kMax && s <= kMax; });
}

std::int64_t goOn(std::int64_t last, std::int64_t before) {
  const auto l = static_cast<std::uint64_t>(last), b = static_cast<std::uint64_t>(before);
  return static_cast<std::int64_t>(l + (l - b));
}
double goOn(double last, double before) {
  const double next = last + (last - before);
  return std::isfinite(next) ? next : last;
}

// The camera was walked before, and `known` is its own.
template <class Walk, class E>
bool walkIteration(Walk& w, E& e, const Known& known) {
  std::uint32_t flags = 0;
  if constexpr (Walk::kWrites) flags = flagsOf(e, known);
  if (!w(flags) || flags > kAllFlags) return false;
  const camera::Pose &last = known.last.pose, &before = known.before.pose;
  if constexpr (!Walk::kWrites) {
    e.pose = known.pose;
    e.view = known.last;
    e.insertions = known.insertions;
    e.edit = known.edit;
    e.settled = flags & kSettled;
    e.hash = known.hash;
  }
  const auto pose = [&](auto field) { return w.near(e.view.pose.*field, goOn(last.*field, before.*field)); };
  if ((flags & kView) && !(w.near(e.pose, known.pose) && pose(&camera::Pose::x) && pose(&camera::Pose::z) && pose(&camera::Pose::y) &&
                           pose(&camera::Pose::yaw) && pose(&camera::Pose::pitch)))
    return false;
  if ((flags & kProjection) && !(w(e.view.projection.verticalFov) && w(e.view.projection.width) && w(e.view.projection.height)))
    return false;
  if constexpr (!Walk::kWrites)
    if (flags & kGranted) e.granted.emplace();
  if ((flags & kGranted) && !walkSettings(w, *e.granted)) return false;
  if ((flags & kInsertions) && !w(e.insertions)) return false;
  if ((flags & kEdit) &&
      !(w(e.edit) && w.list(e.changed, [&](auto& a) { return w(a.x0) && w(a.z0) && w(a.x1) && w(a.z1) && isOnLattice(a); })))
    return false;
  if (!(flags & kHash)) return true;
  return (flags & kView) ? w.fixed(e.hash, 8) : w.fixed(e.hash, 4);
}

void learn(Known& known, const Iterated& e) {
  if (!isSame(e.view.pose, known.last.pose) || e.pose != known.pose) known.before = known.last;
  known.last = e.view;
  known.pose = e.pose;
  known.edit = e.edit;
  known.insertions = e.insertions;
  known.hash = e.hash;
}

// What a record does to the cameras that are known. False: it is about one that is not, or there are too many.
bool follow(std::map<std::uint64_t, Known>& cameras, const Event& event) {
  if (const auto* joined = std::get_if<Joined>(&event)) {
    cameras[joined->camera] = Known{};
    cameras[joined->camera].edit = joined->edit;
    return cameras.size() <= kMaxCameras;
  }
  if (const auto* left = std::get_if<Left>(&event)) return cameras.erase(left->camera) > 0;
  return true;
}

// A record without its time and kind.
template <std::size_t kKind = 0>
bool read(std::size_t kind, In& in, Event& event, std::map<std::uint64_t, Known>& cameras) {
  if constexpr (kKind == std::variant_size_v<Event>) {
    return false;
  } else {
    if (kind != kKind) return read<kKind + 1>(kind, in, event, cameras);
    auto& e = event.emplace<kKind>();
    if constexpr (std::is_same_v<std::remove_reference_t<decltype(e)>, Iterated>) {
      if (!in(e.camera)) return false;
      const auto known = cameras.find(e.camera);
      if (known == cameras.end() || !walkIteration(in, e, known->second) || !in.isOver() || !camera::isValid(e.view)) return false;
      learn(known->second, e);
      return true;
    } else {
      Known none;
      return walk(in, e, none) && in.isOver() && follow(cameras, event);
    }
  }
}

}  // namespace

bool Encoder::put(const Record& record, Bytes& out) {
  Bytes body;
  Out w(body);
  body.push_back(static_cast<std::uint8_t>(record.event.index()));
  w(record.time - time_);
  const bool isKnown = std::visit(
      [&](const auto& e) {
        if constexpr (std::is_same_v<std::decay_t<decltype(e)>, Iterated>) {
          const auto known = cameras_.find(e.camera);
          if (known == cameras_.end()) return false;
          w(e.camera);
          walkIteration(w, e, known->second);
          learn(known->second, e);
        } else {
          Known none;
          walk(w, e, none);
          return follow(cameras_, record.event);
        }
        return true;
      },
      record.event);
  if (!isKnown || body.size() > kMaxRecordBytes) return false;
  time_ = record.time;
  codec::putVarint(out, body.size());
  out.insert(out.end(), body.begin(), body.end());
  return true;
}

Outcome<Record> Decoder::next(std::span<const std::uint8_t>& block) {
  const Error damaged{"A record of it cannot be read: it is damaged, or of another version of Ridgecast."};
  codec::Reader outer(block);
  std::uint64_t size = 0;
  std::span<const std::uint8_t> body;
  if (!outer.longVarint(size) || !outer.bytes(size, body) || body.empty()) return damaged;
  block = outer.rest();
  Record record;
  In in(body.subspan(1));
  std::int64_t passed = 0;
  if (!in(passed) || !read(body[0], in, record.event, cameras_)) return damaged;
  time_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(time_) + static_cast<std::uint64_t>(passed));
  record.time = time_;
  return record;
}

Bytes compress(std::span<const std::uint8_t> block) {
  static thread_local const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(ZSTD_createCCtx(), ZSTD_freeCCtx);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, 3);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  Bytes out(ZSTD_compressBound(block.size()));
  const std::size_t size = ZSTD_compress2(context.get(), out.data(), out.size(), block.data(), block.size());
  if (ZSTD_isError(size)) throw std::runtime_error(ZSTD_getErrorName(size));
  out.resize(size);
  return out;
}

}  // namespace ridgecast::recording
