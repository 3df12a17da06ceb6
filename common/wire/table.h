#pragma once
// Internal to the room: a table for each message says of every field its number and name, where it stands in the value of messages.h and
// what it may be. Reading, writing, refusals, counting before anything is built, and the ranges that PROTOCOL.md states follow from it.
//   V  the value, a type of messages.h      T  the tag of its table
// A message is read in one pass: its fields are found, then each row, in the table's order, reads and checks its own. Repeated fields count
// as in protobuf: the last number or bytes, all of a list; parts of a message are merged; the last kind of a oneof wins.

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "common/wire/coding.h"
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
template <class T>
inline constexpr auto kTable = nullptr;  // each message's own below
template <class V>
struct TableOf;  // its type: the tag of a value's table

struct Verdict {
  std::string refusal;     // in words; empty as long as nothing is wrong
  bool malformed = false;  // not a message of the schema; may be set besides an earlier refusal
};

template <class T>
bool require(bool right, const char* field, const auto& rule, Verdict& verdict) {
  if (!right) verdict.refusal = std::string(kTable<T>.message) + "." + field + " must be " + rule.words();
  return right;
}

// ---- how a member of a value is encoded ----

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
concept Messages = ListOf<M>::value && std::is_class_v<typename M::value_type>;
template <class M>
concept Numbers = ListOf<M>::value && !Messages<M> && !Bytelike<M>;
template <class M>
concept Message = !Number<M> && !Bytelike<M> && !ListOf<M>::value;  // or an optional one

// ---- a table as a whole ----

// What a message holds of a row's field.
struct Held {
  bool there = false;
  std::size_t entries = 0;  // of a list; bytes if the bound is on the encoded size
  Content last;
  std::unique_ptr<std::vector<Content>> earlier;      // of a list; with the last as many as entries at most
  std::unique_ptr<std::vector<std::uint8_t>> joined;  // of a message in several parts; `last` is all of it
  void list(Content next) {
    if (there && !earlier) earlier = std::make_unique<std::vector<Content>>();
    if (there) earlier->push_back(last);
    last = next;
  }
  void join(Content part) {
    if (there && !joined) joined = std::make_unique<std::vector<std::uint8_t>>(last.begin(), last.end());
    if (there) joined->insert(joined->end(), part.begin(), part.end());
    last = there ? Content(*joined) : part;
  }
};
template <class T>
inline constexpr std::size_t kRows = std::tuple_size_v<decltype(kTable<T>.rows)>;
template <class T>
struct Found {
  std::array<Held, kRows<T>> held{};
  std::size_t chosen = kRows<T>;  // the row of a oneof's kind
};

// Calls act(row, index) for each row until one fails.
template <class T, class Do>
bool everyRow(const Do& act) {
  return std::apply(
      [&](const auto&... row) {
        std::size_t k = 0;
        return (act(row, k++) && ...);
      },
      kTable<T>.rows);
}

// Looks for too many entries before any is built.
template <class V, class T>
bool find(Content bytes, Found<T>& found, Verdict& verdict) {
  while (!bytes.empty()) {
    Field field;
    if (!takeField(bytes, field)) return verdict.malformed = true, false;
    if (!everyRow<T>([&](const auto& row, std::size_t k) {
          if (row.number != field.number || !row.template takes<V>(field.type)) return true;
          if (row.kKind && found.chosen != k) {
            if (found.chosen != kRows<T>) found.held[found.chosen] = {};
            found.chosen = k;
          }
          return row.template find<V, T>(field, found.held[k], verdict);
        }))
      return false;
  }
  return true;
}
// False: not read to its end: refused, malformed, or without meaning from there on (EndsWhere).
template <class T, class V>
bool read(V& value, Found<T>& found, Verdict& verdict) {
  return everyRow<T>([&](const auto& row, std::size_t k) { return row.template read<T>(value, found, found.held[k], verdict); });
}
template <class T, class V>
bool read(V& value, Content bytes, Verdict& verdict) {
  Found<T> found;
  return find<V>(bytes, found, verdict) && read<T>(value, found, verdict);
}

// Rows by the numbers of their fields, the order in which they are written.
template <class T>
consteval auto written() {
  const auto numbers = std::apply([](const auto&... row) { return std::array{row.number...}; }, kTable<T>.rows);
  std::array<std::size_t, kRows<T>> order{};
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return numbers[a] < numbers[b]; });
  return order;
}
template <class T, class V>
void write(const V& value, auto& out) {  // to a string, or Counted
  static constexpr auto kOrder = written<T>();
  [&]<std::size_t... k>(std::index_sequence<k...>) { (std::get<kOrder[k]>(kTable<T>.rows).write(value, out), ...); }
  (std::make_index_sequence<kOrder.size()>{});
}

// ---- rows ----

// FIELD of tables.h makes them. Inner: the tag of the inner message's table; void: that of its value's type.
template <class Inner, class Rule, class Member>
struct Row {
  static constexpr bool kKind = false;  // of a oneof
  std::uint32_t number;
  Form form;
  const char* name;
  Rule rule;
  Member member;

  template <class V>
  using MemberOf = std::remove_cvref_t<std::invoke_result_t<Member, V&>>;
  template <class M>
  struct InnerOf : std::conditional<std::is_void_v<Inner>, TableOf<M>, std::type_identity<Inner>>::type {};
  template <class M>
  requires ListOf<M>::value || Maybe<M>::value struct InnerOf<M> : InnerOf<typename M::value_type> {
  };

  template <class V>
  bool takes(WireType type) const {
    using M = MemberOf<V>;
    if constexpr (Number<M>) {
      return type == wireTypeOf<M>(form);
    } else if constexpr (Numbers<M>) {
      return type == WireType::kDelimited || type == wireTypeOf<typename M::value_type>(form);
    } else {
      return type == WireType::kDelimited;
    }
  }

  template <class V, class T>
  bool find(const Field& field, Held& held, Verdict& verdict) const {
    using M = MemberOf<V>;
    std::size_t entries = 1;
    if constexpr (Numbers<M>) {
      const WireType each = wireTypeOf<typename M::value_type>(form);
      if (field.type == WireType::kDelimited && !countPacked(field.content, each, entries)) return verdict.malformed = true, false;
      if (entries == 0) return true;
    }
    if constexpr (std::is_same_v<Rule, Encoded>) entries = field.content.size();
    held.entries += entries;
    if constexpr (ListOf<M>::value || std::is_same_v<Rule, Encoded>)
      if (!require<T>(held.entries <= rule.most, name, rule, verdict)) return false;
    if constexpr (Messages<M> || Numbers<M>) {
      held.list(field.content);
    } else if constexpr (Message<M>) {
      held.join(field.content);
    } else {
      held.last = field.content;
    }
    held.there = true;
    return true;
  }

  template <class T, class V>
  bool read(V& value, const Found<T>&, Held& held, Verdict& verdict) const {
    return readInto<T>(member(value), held, verdict);
  }

  template <class V>
  void write(const V& value, auto& out) const {
    using M = MemberOf<const V>;
    const M& in = member(value);
    if constexpr (Number<M>) {
      if (bitsOf(in, form) == 0) return;
      putTag(out, number, wireTypeOf<M>(form));
      putNumber(out, form, in);
    } else if constexpr (Bytelike<M>) {
      writeBytes(std::string_view(reinterpret_cast<const char*>(in.data()), in.size()), out);
    } else if constexpr (Numbers<M>) {
      if (in.empty()) return;
      delimited(out, [&] { putNumbers(out, form, in); });
    } else if constexpr (Messages<M>) {
      for (const auto& inner : in) writeInner<M>(inner, out);
    } else if constexpr (Maybe<M>::value) {
      if (in) writeInner<M>(*in, out);
    } else {
      writeInner<M>(in, out);
    }
  }

 protected:
  void writeBytes(std::string_view in, auto& out) const {
    if (!in.empty()) delimited(out, [&] { out.append(in.data(), in.size()); });
  }
  void delimited(auto& out, const auto& content) const {
    putTag(out, number, WireType::kDelimited);
    const std::size_t begin = out.size();
    content();
    putLength(out, begin);
  }
  template <class T, class M>
  bool readInto(M& out, Held& held, Verdict& verdict) const {
    if constexpr (Number<M>) {
      out = {};
      if (held.there && !takeNumber(held.last, form, out)) return verdict.malformed = true, false;
      if (!require<T>(rule.holds(out), name, rule, verdict)) return false;
      if constexpr (std::is_same_v<Rule, OneOfOrFirst>) out = rule.orFirst(out);
    } else if constexpr (Bytelike<M>) {
      if (!require<T>(rule.holds(std::string_view(reinterpret_cast<const char*>(held.last.data()), held.last.size())), name, rule, verdict))
        return false;
      out.assign(held.last.begin(), held.last.end());
    } else if constexpr (ListOf<M>::value) {
      out.reserve(held.entries);
      if (held.earlier)
        for (const Content piece : *held.earlier)
          if (!readEntries(out, piece, verdict)) return false;
      if (held.there && !readEntries(out, held.last, verdict)) return false;
      return require<T>(rule.holds(out), name, rule, verdict);
    } else {
      if constexpr (std::is_same_v<Rule, Present>)
        if (!require<T>(held.there, name, rule, verdict)) return false;
      if constexpr (Maybe<M>::value) {
        if (held.there && !wire::read<typename InnerOf<M>::type>(out.emplace(), held.last, verdict)) return false;
      } else {
        if (!wire::read<typename InnerOf<M>::type>(out, held.last, verdict)) return false;
      }
      return require<T>(rule.holds(out), name, rule, verdict);
    }
    return true;
  }

 private:
  template <class M>
  bool readEntries(M& out, Content piece, Verdict& verdict) const {
    if constexpr (Messages<M>) {
      return wire::read<typename InnerOf<M>::type>(out.emplace_back(), piece, verdict);
    } else {
      return takeNumbers(piece, form, out) || (verdict.malformed = true, false);
    }
  }
  template <class M, class V>
  void writeInner(const V& inner, auto& out) const {
    delimited(out, [&] { wire::write<typename InnerOf<M>::type>(inner, out); });
  }
};

// An optional value that travels as another type, `Sent`, made of it and converted back.
template <class Sent, class Base>
struct SentAs : Base {
  template <class T, class V>
  bool read(V& value, const Found<T>&, Held& held, Verdict& verdict) const {
    if (!held.there) return true;
    Sent sent;
    if (!wire::read<typename TableOf<Sent>::type>(sent, held.last, verdict)) return false;
    this->member(value) = sent.value();
    return true;
  }
  template <class V>
  void write(const V& value, auto& out) const {
    const auto& in = this->member(value);
    if (!in) return;
    if constexpr (std::is_same_v<decltype(out), Counted&>)
      out.bytes += Sent::mostBytes(*in);  // it is made once
    else
      this->delimited(out, [&] { wire::write<typename TableOf<Sent>::type>(Sent(*in), out); });
  }
};
template <class Sent, class Base>
constexpr SentAs<Sent, Base> sentAs(Base row) {
  return {row};
}

// One kind of a oneof: `chosen` says whether a value is of it; access to the member of a non-const value makes it so.
template <class Base, class Chosen>
struct Choice : Base {
  static constexpr bool kKind = true;
  Chosen chosen;
  template <class T, class V>
  bool read(V& value, const Found<T>&, Held& held, Verdict& verdict) const {
    return !held.there || this->template readInto<T>(this->member(value), held, verdict);
  }
  template <class V>
  void write(const V& value, auto& out) const {
    if (chosen(value)) Base::write(value, out);
  }
};
template <class Base, class Chosen>
Choice(Base, Chosen) -> Choice<Base, Chosen>;

// A kind that is out of range for itself: the value says why, and the message counts as read.
template <class Base>
struct Excused : Base {
  template <class T, class V>
  bool read(V& value, const Found<T>& found, Held& held, Verdict& verdict) const {
    Verdict own;
    Base::template read<T>(value, found, held, own);
    value.refusal = own.refusal;
    verdict.malformed = own.malformed;
    return !own.malformed;
  }
};
template <class Base>
Excused(Base) -> Excused<Base>;

// Text that is cut to its limit when written.
template <class Base>
struct Cut : Base {
  template <class V>
  void write(const V& value, auto& out) const {
    this->writeBytes(std::string_view(this->member(value)).substr(0, this->rule.most), out);
  }
};
template <class Base>
Cut(Base) -> Cut<Base>;

struct NoField {
  static constexpr bool kKind = false;
  static constexpr std::uint32_t number = 0;
  template <class V>
  bool takes(WireType) const {
    return false;
  }
  template <class V, class T>
  bool find(const Field&, Held&, Verdict&) const {
    return true;
  }
  template <class V>
  void write(const V&, auto&) const {}
};

// A check of the whole value, as read by the rows before.
template <class Rule>
struct Judged : NoField {
  const char* name;
  Rule rule;
  constexpr Judged(const char* field, Rule r) : name(field), rule(r) {}
  template <class T, class V>
  bool read(V& value, const Found<T>&, Held&, Verdict& verdict) const {
    return require<T>(rule.holds(value), name, rule, verdict);
  }
};
constexpr auto also(const char* field, const char* right, auto holds) { return Judged(field, Valid{right, holds}); }

// One kind of a oneof must be there.
struct AnyKind : Judged<Valid<bool>> {
  constexpr AnyKind(const char* field, const char* right) : Judged(field, {right, true}) {}
  template <class T, class V>
  bool read(V&, const Found<T>& found, Held&, Verdict& verdict) const {
    return require<T>(found.chosen != kRows<T>, name, rule, verdict);
  }
};

// Stops reading where it holds; nothing is refused.
template <class Predicate>
struct EndsWhere : NoField {
  Predicate holds;
  constexpr explicit EndsWhere(Predicate p) : holds(p) {}
  template <class T, class V>
  bool read(V& value, const Found<T>&, Held&, Verdict&) const {
    return !holds(value);
  }
};

// What no row can say, of the value after the rows before it.
template <class Act>
struct Then : NoField {
  Act act;
  constexpr explicit Then(Act a) : act(a) {}
  template <class T, class V>
  bool read(V& value, const Found<T>&, Held&, Verdict&) const {
    return act(value), true;
  }
};

}  // namespace ridgecast::wire
