#pragma once
// Internal to the room: a table for each message says of every field what it is called, where it stands in the value of messages.h and what
// it may be. Reading, writing, refusals, counting before anything is built, and the ranges that PROTOCOL.md states follow from it.
//   V  the value, a type of messages.h      P  the generated message

#include <map>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include "common/wire/rules.h"
#include "common/wire/wire.h"

namespace ridgecast::wire {

template <class... Row>
struct Table {
  const char* message;
  std::tuple<Row...> rows;
};
template <class... Row>
constexpr Table<Row...> table(const char* message, Row... rows) {
  return {message, {rows...}};
}
template <class P>
inline constexpr auto kTable = nullptr;  // each message's own below

// What is wrong, in words; empty as long as nothing is.
using Refusal = std::string;

template <class P>
bool require(bool right, const char* field, const auto& rule, Refusal& refusal) {
  if (!right) refusal = std::string(kTable<P>.message) + "." + field + " must be " + rule.words();
  return right;
}

// Every row in turn, until one fails.
template <class P, class Do>
bool everyRow(const Do& act) {
  return std::apply([&](const auto&... row) { return (act(row) && ...); }, kTable<P>.rows);
}

template <class V, class P>
bool read(V& value, P& in, Refusal& refusal) {
  return everyRow<P>([&](const auto& row) { return row.read(value, in, refusal); });
}
template <class V, class P>
void write(const V& value, P& out) {
  everyRow<P>([&](const auto& row) { return row.write(value, out), true; });
}

// ---- how a member of a value is laid down ----

template <class T>
struct ListOf : std::false_type {};
template <class T>
struct ListOf<std::vector<T>> : std::true_type {};
template <class T>
struct Maybe : std::false_type {};
template <class T>
struct Maybe<std::optional<T>> : std::true_type {};

template <class M>
concept Bytelike = std::is_same_v<M, std::string> || std::is_same_v<M, std::vector<std::uint8_t>>;
template <class M>
concept Number = std::is_arithmetic_v<M> || std::is_enum_v<M>;
template <class M>
concept Messages = ListOf<M>::value && std::is_class_v<typename M::value_type>;
template <class M>
concept Numbers = ListOf<M>::value && !Messages<M> && !Bytelike<M>;
template <class M>
concept Message = !Number<M> && !Bytelike<M> && !ListOf<M>::value && !Maybe<M>::value;

// A field of a message that is not built: its number, and its content when it is length-delimited.
struct Field {
  std::uint32_t number = 0;
  bool delimited = false;
  std::span<const std::uint8_t> content;
};
// Moves `bytes` behind the field. False: malformed (groups count as malformed).
inline bool nextField(std::span<const std::uint8_t>& bytes, Field& field) {
  using Wire = google::protobuf::internal::WireFormatLite;
  google::protobuf::io::CodedInputStream in(bytes.data(), static_cast<int>(bytes.size()));
  const std::uint32_t tag = in.ReadTag();
  const Wire::WireType type = Wire::GetTagWireType(tag);
  field = {.number = tag >> 3, .delimited = type == Wire::WIRETYPE_LENGTH_DELIMITED, .content = {}};
  if (field.number == 0 || type == Wire::WIRETYPE_START_GROUP) return false;
  int length = 0;
  if (field.delimited ? !in.ReadVarintSizeAsInt(&length) || !in.Skip(length) : !Wire::SkipField(&in, tag)) return false;
  const auto end = static_cast<std::size_t>(in.CurrentPosition());
  if (field.delimited) field.content = bytes.first(end).last(static_cast<std::size_t>(length));
  bytes = bytes.subspan(end);
  return true;
}

// Entries of repeated fields and bytes of messages seen so far, by what bounds them.
using Counts = std::map<const void*, std::size_t>;

template <class V, class P>
bool scan(std::span<const std::uint8_t> bytes, Counts& counts, Refusal& refusal);
template <class V, class P>
constexpr bool anyCounted();

// ---- rows ----

// FIELD of tables.h makes them: functions to the value's member and to the generated accessors.
template <class Rule, class Member, class Get, class Mutable, class Has, class Set>
struct Row {
  const char* name;
  Rule rule;
  Member member;
  Get get;
  Mutable mutate;
  Has has;
  Set set;

  template <class V>
  using MemberOf = std::remove_cvref_t<std::invoke_result_t<Member, V&>>;
  template <class P>
  using InnerOf = std::remove_pointer_t<std::invoke_result_t<Mutable, P&>>;

  template <class V, class P>
  bool read(V& value, P& in, Refusal& refusal) const {
    using M = MemberOf<V>;
    M& out = member(value);
    if (!require<P>(rule.holds(get(in)), name, rule, refusal)) return false;
    if constexpr (Number<M>) {
      out = static_cast<M>(get(in));
      if constexpr (std::is_same_v<Rule, OneOfOrFirst>) out = rule.valid(static_cast<int>(out)) ? out : M{};
    } else if constexpr (Bytelike<M>) {
      if (get(in).empty()) return true;
      out.assign(get(in).begin(), get(in).end());
      std::string().swap(*mutate(in));  // never twice in memory for long
    } else if constexpr (Numbers<M>) {
      out.assign(get(in).begin(), get(in).end());
    } else if constexpr (Messages<M>) {
      out.reserve(static_cast<std::size_t>(get(in).size()));
      for (auto& inner : *mutate(in))
        if (!wire::read(out.emplace_back(), inner, refusal)) return false;
    } else if constexpr (Maybe<M>::value) {
      return !has(in) || wire::read(out.emplace(), *mutate(in), refusal);
    } else {
      return wire::read(out, *mutate(in), refusal);
    }
    return true;
  }

  template <class V, class P>
  void write(const V& value, P& out) const {
    using M = MemberOf<const V>;
    const M& in = member(value);
    if constexpr (Number<M>) {
      set(out, static_cast<std::remove_cvref_t<decltype(get(out))>>(in));
    } else if constexpr (Bytelike<M>) {
      mutate(out)->assign(in.begin(), in.end());
    } else if constexpr (Numbers<M>) {
      mutate(out)->Add(in.begin(), in.end());
    } else if constexpr (Messages<M>) {
      for (const auto& inner : in) wire::write(inner, *mutate(out)->Add());
    } else if constexpr (Maybe<M>::value) {
      if (in) wire::write(*in, *mutate(out));
    } else {
      wire::write(in, *mutate(out));
    }
  }

  // Counts it in the bytes of a message, and what is counted inside of it.
  template <class V, class P>
  bool scan(const Field& field, Counts& counts, Refusal& refusal) const {
    using M = MemberOf<V>;
    if constexpr (counted<V, P>()) {
      if (field.number != number<P>()) return true;
      if constexpr (Messages<M>) return require<P>(++counts[this] <= rule.most, name, rule, refusal);
      if constexpr (std::is_same_v<Rule, Encoded>) {
        const std::size_t bytes = counts[rule.most] += field.content.size();
        if (!require<P>(bytes <= *rule.most, name, rule, refusal)) return false;
      }
      if constexpr (innerCounted<M, P>()) return !field.delimited || wire::scan<M, InnerOf<P>>(field.content, counts, refusal);
    }
    return true;
  }
  template <class V, class P>
  static constexpr bool counted() {
    return Messages<MemberOf<V>> || std::is_same_v<Rule, Encoded> || innerCounted<MemberOf<V>, P>();
  }

 private:
  template <class M, class P>
  static constexpr bool innerCounted() {
    if constexpr (Message<M>) return anyCounted<M, InnerOf<P>>();
    return false;
  }
  // The only tag of a message that holds nothing but this field.
  template <class P>
  std::uint32_t number() const {
    static const std::uint32_t known = [this] {
      P message;
      if constexpr (requires(InnerOf<P> & list) { list.Add(); }) {
        mutate(message)->Add();
      } else {
        mutate(message);
      }
      const std::string bytes = message.SerializeAsString();
      google::protobuf::io::CodedInputStream in(reinterpret_cast<const std::uint8_t*>(bytes.data()), static_cast<int>(bytes.size()));
      return in.ReadTag() >> 3;
    }();
    return known;
  }
};
template <class... Part>
Row(const char*, Part...) -> Row<Part...>;

// One kind of a oneof: `chosen` says whether a value is of it; the member of a value that is not const makes it so.
template <class Base, class Chosen>
struct Choice : Base {
  Chosen chosen;
  template <class V, class P>
  bool read(V& value, P& in, Refusal& refusal) const {
    return !this->has(in) || wire::read(this->member(value), *this->mutate(in), refusal);
  }
  template <class V, class P>
  void write(const V& value, P& out) const {
    if (chosen(value)) wire::write(this->member(value), *this->mutate(out));
  }
};
template <class Base, class Chosen>
Choice(Base, Chosen) -> Choice<Base, Chosen>;

// A kind that is out of range for itself: the value says why, and the message counts as read.
template <class Base>
struct Excused : Base {
  template <class V, class P>
  bool read(V& value, P& in, Refusal&) const {
    Base::read(value, in, value.refusal);
    return true;
  }
};
template <class Base>
Excused(Base) -> Excused<Base>;

struct NoField {
  template <class V, class P>
  bool read(V&, P&, Refusal&) const {
    return true;
  }
  template <class V, class P>
  void write(const V&, P&) const {}
  template <class V, class P>
  bool scan(const Field&, Counts&, Refusal&) const {
    return true;
  }
  template <class V, class P>
  static constexpr bool counted() {
    return false;
  }
};

// A rule for what `get` takes from the message; the value gets nothing of it.
template <class Rule, class Get>
struct Judged : NoField {
  const char* name;
  Rule rule;
  Get get;
  constexpr Judged(const char* field, Rule r, Get g) : name(field), rule(r), get(g) {}
  template <class V, class P>
  bool read(V&, P& in, Refusal& refusal) const {
    return require<P>(rule.holds(get(in)), name, rule, refusal);
  }
};
// A field that is right where the whole message says so.
constexpr auto also(const char* field, const char* right, auto holds) {
  return Judged(
      field, Valid{right, holds}, [](const auto& p) -> const auto& { return p; });
}

// Reads no further where it holds; nothing is refused.
template <class Predicate>
struct EndsWhere : NoField {
  Predicate holds;
  constexpr explicit EndsWhere(Predicate p) : holds(p) {}
  template <class V, class P>
  bool read(V&, P& in, Refusal&) const {
    return !holds(in);
  }
};

// What no row can say: (value, message) after the rows before it.
template <class Read, class Write>
struct Then : NoField {
  Read reads;
  Write writes;
  constexpr Then(Read r, Write w) : reads(r), writes(w) {}
  template <class V, class P>
  bool read(V& value, P& in, Refusal&) const {
    return reads(value, in), true;
  }
  template <class V, class P>
  void write(const V& value, P& out) const {
    writes(value, out);
  }
};

// ---- tables as a whole ----

template <class V, class P>
constexpr bool anyCounted() {
  return std::apply([](const auto&... row) { return (row.template counted<V, P>() || ...); }, kTable<P>.rows);
}

// Looks for too many entries before any is built. False: refused, or without a refusal no well-formed message.
template <class V, class P>
bool scan(std::span<const std::uint8_t> bytes, Counts& counts, Refusal& refusal) {
  Field field;
  while (!bytes.empty()) {
    if (!nextField(bytes, field)) return false;
    if (!everyRow<P>([&](const auto& row) { return row.template scan<V, P>(field, counts, refusal); })) return false;
  }
  return true;
}

}  // namespace ridgecast::wire
