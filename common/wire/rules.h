#pragma once
// Internal to the room: what a field may be. A rule judges the field's value and says in words what is right; refusals and PROTOCOL.md use
// the same words.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace ridgecast::wire {

std::string numberWords(double v);      // 8,192   2^50   1e6   0.02
std::string bytesWords(std::size_t n);  // 128 bytes   64 MiB

struct Any {
  std::string words() const { return {}; }
  bool holds(const auto&) const { return true; }
};

template <class T>
struct Range {
  T low, high;
  const char* unit = "";
  const char* instead = "";  // of the numbers
  std::string words() const;
  template <class V>
  bool holds(V v) const {
    if constexpr (std::is_integral_v<T> && std::is_integral_v<V>) {
      return std::cmp_greater_equal(v, low) && std::cmp_less_equal(v, high);
    } else {
      return v >= low && v <= high;  // no NaN
    }
  }
};
template <class T, class... Text>
Range(T, T, Text...) -> Range<T>;  // the guides are for clang before 17
template <class T>
constexpr Range<T> within(T most, const char* unit) {
  return {-most, most, unit};
}
template <class T>
constexpr Range<T> atMost(T most, const char* unit) {
  return {T{}, most, unit};
}
template <class T>
constexpr Range<T> atLeast(T least) {
  return {least, std::numeric_limits<T>::max()};
}

template <class T>
std::string Range<T>::words() const {
  const auto number = [](T v) { return numberWords(static_cast<double>(v)); };
  std::string out = instead;
  if (out.empty() && high == std::numeric_limits<T>::max()) out = "at least " + number(low);
  if (out.empty() && low == high) out = number(low);
  if (out.empty() && std::is_signed_v<T> && low == -high) out = "within +-" + number(high);
  if (out.empty() && std::is_unsigned_v<T> && low == 0) out = "at most " + number(high);
  if (out.empty()) out = number(low) + " to " + number(high);
  return *unit ? out + " " + unit : out;
}

struct Bytes {
  std::size_t most;
  std::string words() const { return "at most " + bytesWords(most); }
  bool holds(std::string_view s) const { return s.size() <= most; }
};

struct Text {
  std::size_t most;
  std::string words() const { return Bytes{most}.words() + ", no control characters"; }
  bool holds(std::string_view s) const {
    return s.size() <= most && std::none_of(s.begin(), s.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; });
  }
};

// An enum of the schema, by the names of its values from 0 on.
struct OneOf {
  std::span<const char* const> names;
  std::string words() const;
  bool holds(auto v) const { return knows(v); }

 protected:
  bool knows(auto v) const { return static_cast<int>(v) >= 0 && static_cast<std::size_t>(v) < names.size(); }
};

// Of a later revision, read as 0.
struct OneOfOrFirst : OneOf {
  std::string words() const { return OneOf::words() + "; others count as the first"; }
  bool holds(auto) const { return true; }
  auto orFirst(auto v) const { return knows(v) ? v : decltype(v){}; }
};

template <class Each = Any>
struct Entries {
  std::size_t most;
  Each each = {};
  std::string words() const {
    const std::string inner = each.words();
    return "at most " + numberWords(static_cast<double>(most)) + " entries" + (inner.empty() ? "" : "; each " + inner);
  }
  bool holds(const auto& list) const {
    return static_cast<std::size_t>(list.size()) <= most &&
           std::all_of(list.begin(), list.end(), [&](const auto& v) { return each.holds(v); });
  }
};

template <class Each = Any>
Entries(std::size_t, Each = {}) -> Entries<Each>;

// The encoded size of a message, before it is built.
struct Encoded {
  std::size_t most;
  std::string words() const { return Bytes{most}.words(); }
  bool holds(const auto&) const { return true; }
};

// A message that must be there.
struct Present {
  std::string words() const { return "present"; }
  bool holds(const auto&) const { return true; }
};

template <class Predicate>
struct Valid {
  const char* right;
  Predicate holds;
  std::string words() const { return right; }
};
template <class Predicate>
Valid(const char*, Predicate) -> Valid<Predicate>;

}  // namespace ridgecast::wire
