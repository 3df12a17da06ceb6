#include "common/edits/packed.h"

#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include "common/terrain/raster.h"

namespace ridgecast::edits {
namespace {

using lattice::Point;
using lattice::Vertex;

constexpr std::uint8_t kForm = 1;

class Packer {
 public:
  explicit Packer(const Operation& operation) : bytes_{kForm, static_cast<std::uint8_t>(8 * operation.material + operation.what.index())} {}
  void operator()(std::uint64_t v) {
    for (; v >= 0x80; v >>= 7) bytes_.push_back(static_cast<std::uint8_t>(v | 0x80));
    bytes_.push_back(static_cast<std::uint8_t>(v));
  }
  void operator()(std::uint32_t v) { (*this)(std::uint64_t{v}); }
  void operator()(std::int64_t v) { (*this)((static_cast<std::uint64_t>(v) << 1) ^ static_cast<std::uint64_t>(v >> 63)); }
  void operator()(std::int32_t v) { (*this)(std::int64_t{v}); }
  void operator()(bool v) { (*this)(std::uint64_t{v}); }
  std::size_t count(std::size_t is, std::size_t) { return (*this)(std::uint64_t{is}), is; }
  void samples(std::span<const std::int32_t> all, std::size_t columns) { terrain::encodeSamples(all, columns, bytes_); }
  std::string take() const { return {bytes_.begin(), bytes_.end()}; }

 private:
  std::vector<std::uint8_t> bytes_;
};

// After a failure all that follows is 0.
class Unpacker {
 public:
  explicit Unpacker(std::string_view bytes) : bytes_(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()) {}
  template <class T>
  void operator()(T& v) {
    std::uint64_t bits = 0;
    for (int shift = 0;; shift += 7) {
      if (bytes_.empty() || shift > 63) return fail();
      const std::uint8_t b = bytes_.front();
      bytes_ = bytes_.subspan(1);
      bits |= std::uint64_t{b & 0x7fu} << shift;
      if (b < 0x80) break;
    }
    if constexpr (std::is_signed_v<T>) {
      const std::int64_t whole = static_cast<std::int64_t>(bits >> 1) ^ -static_cast<std::int64_t>(bits & 1);
      if (whole < std::numeric_limits<T>::min() || whole > std::numeric_limits<T>::max()) return fail();
      v = static_cast<T>(whole);
    } else {
      if (bits > std::numeric_limits<T>::max()) return fail();
      v = static_cast<T>(bits);
    }
  }
  std::size_t count(std::size_t, std::size_t most) {
    std::uint64_t count = 0;
    (*this)(count);
    if (count > most) fail();
    return failed_ ? 0 : static_cast<std::size_t>(count);
  }
  void samples(std::vector<std::int32_t>& all, std::size_t columns) {
    if (failed_ || !terrain::decodeSamples(bytes_, columns, all)) return fail();
    bytes_ = {};
  }
  bool isDone() const { return !failed_ && bytes_.empty(); }

 private:
  void fail() {
    failed_ = true;
    bytes_ = {};
  }
  std::span<const std::uint8_t> bytes_;
  bool failed_ = false;
};

template <class Io, class Place>
void place(Io& io, Place& p) {
  io(p.x);
  io(p.z);
}

// Each place as the difference from the one before it. `height`: of places that have one.
template <class Io, class Line, class Height>
void line(Io& io, Line& all, std::size_t most, const Height& height) {
  const std::size_t size = io.count(all.size(), most);
  if constexpr (!std::is_const_v<Line>) all.resize(size);
  typename std::remove_const_t<Line>::value_type before{};
  for (auto& p : all) {
    // Places that are far apart are refused by check(); until then they may wrap.
    const auto part = [&io](auto& is, auto was) {
      using Whole = std::uint64_t;
      auto by = static_cast<std::int64_t>(static_cast<Whole>(is) - static_cast<Whole>(was));
      io(by);
      if constexpr (!std::is_const_v<Line>)
        is = static_cast<std::remove_reference_t<decltype(is)>>(static_cast<Whole>(was) + static_cast<Whole>(by));
    };
    part(p.x, before.x);
    part(p.z, before.z);
    height(p, before, part);
    before = p;
  }
}

template <class Io>
void fields(Io& io, auto& o) {
  using Kind = std::remove_cvref_t<decltype(o)>;
  if constexpr (std::is_same_v<Kind, Raise>) {
    place(io, o.at);
    io(o.radius);
    io(o.core);
    io(o.amount);
  } else if constexpr (std::is_same_v<Kind, Crater>) {
    place(io, o.at);
    io(o.radius);
    io(o.depth);
  } else if constexpr (std::is_same_v<Kind, Level>) {
    line(io, o.corners, kMaxCorners, [](auto&, auto&, auto&) {});
    io(o.radius);
    io(o.height);
    io(o.slope);
  } else if constexpr (std::is_same_v<Kind, Smooth>) {
    place(io, o.at);
    io(o.radius);
    io(o.passes);
  } else if constexpr (std::is_same_v<Kind, Road>) {
    io(o.surveyed);
    line(io, o.line, kMaxStations, [&o](auto& p, auto& before, const auto& part) {
      if (o.surveyed) part(p.y, before.y);
    });
    io(o.width);
    io(o.grade);
    io(o.slope);
  } else if constexpr (std::is_same_v<Kind, Stamp>) {
    place(io, o.at);
    io(o.width);
    io(o.height);
    io(o.spacing);
    if constexpr (!std::is_const_v<std::remove_reference_t<decltype(o)>>)
      if (o.width <= kMaxStampSide && o.height <= kMaxStampSide) o.samples.resize(std::size_t{o.width} * o.height);
    io.samples(o.samples, o.width);
  } else {
    io(o.edit);
  }
}

template <std::size_t kKind = 0>
bool makeKind(std::size_t kind, Operation& out) {
  if constexpr (kKind == std::variant_size_v<decltype(out.what)>) {
    return false;
  } else {
    if (kind != kKind) return makeKind<kKind + 1>(kind, out);
    out.what.emplace<kKind>();
    return true;
  }
}

}  // namespace

std::string pack(const Operation& operation) {
  Packer packer(operation);
  std::visit([&](const auto& o) { fields(packer, o); }, operation.what);
  return packer.take();
}

Outcome<Operation> unpack(std::string_view bytes) {
  if (bytes.size() < 2 || bytes[0] != kForm) return Error{"An edit's bytes have a form that is not known; this program reads form 1."};
  const auto head = static_cast<std::uint8_t>(bytes[1]);
  Operation out{{}, std::uint32_t{head} / 8};
  Unpacker unpacker(bytes.substr(2));
  if (makeKind(head % 8, out))
    std::visit([&](auto& o) { fields(unpacker, o); }, out.what);
  else
    return Error{"An edit's bytes are of a kind that is not known."};
  if (!unpacker.isDone()) return Error{"An edit's bytes are cut off, too long, or hold a number out of range."};
  if (auto checked = check(out); !checked) return checked.error();
  if (pack(out) != bytes) return Error{"An edit's bytes are not the shortest of that edit."};
  return out;
}

std::uint64_t undoneBy(std::string_view packed) {
  constexpr std::size_t kMaxBytes = 12;
  if (packed.size() > kMaxBytes || static_cast<std::uint8_t>(packed[1]) % 8 != 6) return 0;
  Unpacker unpacker(packed.substr(2));
  std::uint64_t edit = 0;
  unpacker(edit);
  return edit;
}

}  // namespace ridgecast::edits
