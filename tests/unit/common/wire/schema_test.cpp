// The tables are the schema: protobuf, by its reflection, writes what they read and reads what they write.
#include <google/protobuf/unknown_field_set.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "common/wire/tables.h"
#include "common/wire/wire.h"
#include "tests/support/bytes.h"
#include "tests/support/sanitized.h"
#include "tests/unit/common/wire/random_message.h"

namespace ridgecast::wire {
namespace {

using testing_support::bytesOf;

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Reflection;

// ---- names ----

template <class T, class V>
void expectRowsOf(const Descriptor& type);

template <class T, class V>
void expectField(const NoField&, const Descriptor&) {}
template <class T, class V, class Inner, class Rule, class Member>
void expectField(const Row<Inner, Rule, Member>& row, const Descriptor& type) {
  const FieldDescriptor* field = type.FindFieldByName(row.name);
  ASSERT_TRUE(field) << type.name() << " has no " << row.name;
  EXPECT_EQ(static_cast<int>(row.number), field->number()) << field->full_name();
  if constexpr (std::is_base_of_v<OneOf, Rule>) {
    std::string names;
    for (int k = 0; k < field->enum_type()->value_count(); ++k) names += (k ? ", " : "") + field->enum_type()->value(k)->name();
    EXPECT_EQ(row.rule.OneOf::words(), names);
  }
  using M = typename Row<Inner, Rule, Member>::template MemberOf<V>;
  if constexpr (std::is_same_v<Rule, Encoded> && Maybe<M>::value) {
    expectRowsOf<CandidatesTable, SentCandidates>(*field->message_type());
  } else if constexpr (Messages<M> || Maybe<M>::value) {
    expectRowsOf<typename Row<Inner, Rule, Member>::template InnerOf<M>::type, typename M::value_type>(*field->message_type());
  } else if constexpr (Message<M>) {
    expectRowsOf<typename Row<Inner, Rule, Member>::template InnerOf<M>::type, M>(*field->message_type());
  }
}
template <class T, class V>
void expectRowsOf(const Descriptor& type) {
  everyRow<T>([&](const auto& row, std::size_t) { return expectField<T, V>(row, type), true; });
}

TEST(Schema, RowsAreCalledAndNumberedAsTheFields) {
  expectRowsOf<ClientMessageTable, ClientMessage>(*pb::ClientMessage::descriptor());
  expectRowsOf<ServerMessageTable, ServerMessage>(*pb::ServerMessage::descriptor());
}

// ---- messages ----

bool mayBeAbsent(const FieldDescriptor& field) {
  return field.containing_oneof() || field.full_name() == "ridgecast.v1.World.height_map" ||
         field.full_name() == "ridgecast.v1.Member.moved" || field.full_name() == "ridgecast.v1.Members.crowd" ||
         field.full_name() == "ridgecast.v1.Iteration.candidates";
}

// As this room writes what it has read: what stands below is all that it changes.
void normalise(google::protobuf::Message& message) {
  const Reflection& reflection = *message.GetReflection();
  reflection.MutableUnknownFields(&message)->Clear();
  for (int k = 0; k < message.GetDescriptor()->field_count(); ++k) {
    const FieldDescriptor& field = *message.GetDescriptor()->field(k);
    if (field.cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (field.is_repeated()) {
      for (int n = 0; n < reflection.FieldSize(message, &field); ++n) normalise(*reflection.MutableRepeatedMessage(&message, &field, n));
    } else if (reflection.HasField(message, &field) || !mayBeAbsent(field)) {
      normalise(*reflection.MutableMessage(&message, &field));
    }
  }
  if (auto* hello = dynamic_cast<pb::Hello*>(&message)) {
    if (!pb::Role_IsValid(hello->role())) hello->clear_role();
  } else if (auto* error = dynamic_cast<pb::Error*>(&message)) {
    if (!pb::Error::Code_IsValid(error->code())) error->clear_code();
  } else if (auto* member = dynamic_cast<pb::Member*>(&message)) {
    if (!pb::Role_IsValid(member->role())) member->clear_role();
    if (member->has_moved()) member->mutable_moved()->clear_camera();
  } else if (auto* world = dynamic_cast<pb::World*>(&message)) {
    if (!pb::Known_IsValid(world->known())) world->clear_known();
  } else if (auto* figures = dynamic_cast<pb::Figures*>(&message)) {
    figures->set_valid_leaves(figures->leaves());
  } else if (auto* candidates = dynamic_cast<pb::Candidates*>(&message)) {
    const std::int64_t x = candidates->points_size() ? candidates->points(0) : -candidates->x();
    const std::int64_t z = candidates->points_size() ? candidates->points(1) : -candidates->z();
    candidates->set_x(candidates->x() + x);
    candidates->set_z(candidates->z() + z);
    for (int k = 0; k < candidates->points_size(); k += 3) {
      candidates->set_points(k, static_cast<std::int32_t>(candidates->points(k) - x));
      candidates->set_points(k + 1, static_cast<std::int32_t>(candidates->points(k + 1) - z));
    }
  }
}

// Whether it is answered by its version alone, or by a query's own refusal.
bool isReadInPart(const ClientMessage& m) {
  if (const auto* hello = std::get_if<Hello>(&m)) return hello->protocolVersion != kProtocolVersion;
  const auto* query = std::get_if<Query>(&m);
  return query && !query->refusal.empty();
}
bool isReadInPart(const ServerMessage& m) {
  const auto* world = std::get_if<World>(&m);
  return (world && world->protocolVersion != kProtocolVersion) || std::holds_alternative<UnknownKind>(m);
}

const std::string kMalformed = "The bytes are not a message of protocol version 1 (see PROTOCOL.md).";

// A kind that a later one replaced is skipped here, but parsed by protobuf.
template <class P>
bool holdsReplacedKind(const std::string& bytes) {
  const auto fields = [](Content rest, auto&& count) {
    int n = 0;
    for (Field field; !rest.empty() && takeField(rest, field);) n += count(field);
    return n;
  };
  const bool inQuery = fields(bytesOf(bytes), [&](const Field& field) {
    return field.number == 10 && std::is_same_v<P, pb::ClientMessage> && field.type == WireType::kDelimited &&
           fields(field.content, [](const Field& kind) { return kind.number >= 2 && kind.number <= 4; }) > 1;
  });
  return inQuery || fields(bytesOf(bytes), [](const Field& field) {
                      return P::descriptor()->FindFieldByNumber(static_cast<int>(field.number)) != nullptr;
                    }) > 1;
}
// A group is malformed here, but skipped by protobuf.
bool holdsGroup(const google::protobuf::Message& message) {
  const Reflection& reflection = *message.GetReflection();
  const auto& unknown = reflection.GetUnknownFields(message);
  for (int k = 0; k < unknown.field_count(); ++k)
    if (unknown.field(k).type() == google::protobuf::UnknownField::TYPE_GROUP) return true;
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (!field->is_repeated() && holdsGroup(reflection.GetMessage(message, field))) return true;
    for (int n = 0; field->is_repeated() && n < reflection.FieldSize(message, field); ++n)
      if (holdsGroup(reflection.GetRepeatedMessage(message, field, n))) return true;
  }
  return false;
}

// How many were accepted.
template <class P>
int judge(RandomMessage& random, int count, int damaged, auto decode) {
  int accepted = 0;
  for (int k = 0; k < count; ++k) {
    P message;
    random.fill(message);
    std::string bytes = message.SerializeAsString();
    if (random.wild()) {  // in two parts
      P more;
      random.fill(more);
      bytes += more.SerializeAsString();
    }
    for (; !bytes.empty() && random.number() % 100 < static_cast<std::uint64_t>(damaged);) {
      const std::size_t at = random.number() % bytes.size();
      switch (random.number() % 4) {
        case 0:
          bytes[at] = static_cast<char>(bytes[at] ^ 1 << random.number() % 8);
          break;
        case 1:
          bytes[at] = static_cast<char>(random.number());
          break;
        case 2:
          bytes.insert(at, 1, static_cast<char>(random.number()));
          break;
        default:
          bytes.resize(at);
      }
    }
    const auto decoded = decode(bytesOf(bytes));
    P parsed;
    const bool parses = parsed.ParseFromString(bytes);
    if (decoded && isReadInPart(*decoded)) continue;
    if (decoded) {
      ++accepted;
      EXPECT_TRUE(parses || holdsReplacedKind<P>(bytes));
      if (!parses) continue;
      normalise(parsed);
      EXPECT_EQ(encode(*decoded), parsed.SerializeAsString()) << parsed.ShortDebugString();
      EXPECT_TRUE(decode(bytesOf(encode(*decoded)))) << "what is accepted is valid";
    } else if (decoded.error().message == kMalformed) {
      EXPECT_TRUE(!parses || holdsGroup(parsed) || parsed.kind_case() == P::KIND_NOT_SET) << parsed.ShortDebugString();
    } else if (parses) {
      const auto again = decode(bytesOf(parsed.SerializeAsString()));  // whatever the order of the fields
      EXPECT_EQ(again ? "accepted" : again.error().message, decoded.error().message) << parsed.ShortDebugString();
    }
    if (testing::Test::HasFailure()) break;
  }
  return accepted;
}

// NIGHTLY: ten million.
int messages() {
  const char* asked = std::getenv("MESSAGES");
  return testing_support::rounds(asked ? std::atoi(asked) : 200'000) / 4;
}

TEST(Schema, RandomMessagesAreTheSameBytes) {
  RandomMessage random(1, 0);
  const int count = messages();
  EXPECT_GT(judge<pb::ClientMessage>(random, count, 0, decodeClient), count * 9 / 10);
  EXPECT_GT(judge<pb::ServerMessage>(random, count, 0, decodeServer), count * 9 / 10);
}

TEST(Schema, WildAndDamagedMessagesAreJudgedAsProtobufDoes) {
  RandomMessage random(2, 20);
  const int count = messages();
  EXPECT_GT(judge<pb::ClientMessage>(random, count, 20, decodeClient), count / 4);
  EXPECT_GT(judge<pb::ServerMessage>(random, count, 20, decodeServer), count / 4);
}

std::string field(std::uint32_t number, const std::string& content) {
  std::string out;
  putTag(out, number, WireType::kDelimited);
  putVarint(out, content.size());
  return out + content;
}

TEST(Schema, NumbersOfAListMayComeOneByOne) {
  std::string places;
  for (const lattice::Step x : {0, -7, 1 << 30}) {
    putTag(places, 1, WireType::kVarint);
    putNumber(places, Form::kOfType, x);
  }
  pb::Places asOne;
  for (const std::int64_t z : {0, 7, -(1 << 30)}) asOne.add_z(z);
  const auto decoded = decodeClient(bytesOf(field(10, field(2, places + asOne.SerializeAsString()))));
  ASSERT_TRUE(decoded) << decoded.error().message;
  EXPECT_EQ(std::get<Query>(*decoded).x, (std::vector<lattice::Step>{0, -7, 1 << 30}));
  EXPECT_EQ(std::get<Query>(*decoded).z, (std::vector<lattice::Step>{0, 7, -(1 << 30)}));
}

TEST(Schema, AFieldOfTheGreatestNumberIsSkipped) {
  const std::string later = field((1u << 29) - 1, "later");
  EXPECT_TRUE(decodeClient(bytesOf(field(6, later) + later)));
}

TEST(Schema, WhatIsMalformedInsideIsMalformed) {
  const std::string number = "\x80", ray = field(1, "\x08\x02\x08");
  for (const std::string& query : {field(2, field(1, number)), field(4, ray), field(4, "\x0b")}) {
    const auto decoded = decodeClient(bytesOf(field(10, query)));
    ASSERT_FALSE(decoded);
    EXPECT_EQ(decoded.error().message, kMalformed);
  }
}

}  // namespace
}  // namespace ridgecast::wire
