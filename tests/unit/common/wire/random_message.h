#pragma once
// Random messages of the schema, by protobuf's reflection: mostly in range, now and then far out of it.

#include <google/protobuf/message.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>
#include <string>

#include "common/lattice/lattice.h"
#include "ridgecast/v1/stream.pb.h"

namespace ridgecast::wire {

namespace pb = ridgecast::v1;

class RandomMessage {
 public:
  // wildness: of a thousand values, those that are anything.
  RandomMessage(std::uint64_t seed, std::uint64_t wildness) : random_(seed), wildness_(wildness) {}

  void fill(google::protobuf::Message& message) {
    const auto& reflection = *message.GetReflection();
    const auto& type = *message.GetDescriptor();
    const auto* oneof = type.oneof_decl_count() > 0 ? type.oneof_decl(0) : nullptr;
    const Field* kind = oneof ? oneof->field(static_cast<int>(random_() % static_cast<std::uint64_t>(oneof->field_count()))) : nullptr;
    for (int k = 0; k < type.field_count(); ++k) {
      const auto& field = *type.field(k);
      if (field.containing_oneof() ? &field != kind : random_() % 5 == 0) continue;
      if (!field.is_repeated()) {
        set(message, reflection, field);
      } else {
        for (std::uint64_t n = wild() ? random_() % 80 : random_() % 4; n > 0; --n) set(message, reflection, field);
      }
    }
    if (wild() && wild()) reflection.MutableUnknownFields(&message)->AddVarint(1000, random_());
    if (!wild()) mend(message);
  }

  bool wild() { return random_() % 1000 < wildness_; }
  std::uint64_t number() { return random_(); }

 private:
  using Field = google::protobuf::FieldDescriptor;

  std::int64_t integer() {
    if (!wild()) return static_cast<std::int64_t>(random_() % 4);
    const std::int64_t some[] = {0,
                                 -1,
                                 20,
                                 1000,
                                 lattice::kMaxPosition,
                                 -lattice::kMaxPosition,
                                 lattice::kMaxPosition + 1,
                                 std::numeric_limits<std::int32_t>::max(),
                                 std::numeric_limits<std::int32_t>::min(),
                                 std::numeric_limits<std::int64_t>::max(),
                                 std::numeric_limits<std::int64_t>::min(),
                                 static_cast<std::int64_t>(random_())};
    return some[random_() % std::size(some)];
  }
  double real() {
    if (!wild()) return static_cast<double>(random_() % 9) / 8;
    const double some[] = {-0.0,
                           -1,
                           1e6,
                           1e16,
                           std::numeric_limits<double>::quiet_NaN(),
                           std::numeric_limits<double>::infinity(),
                           std::numeric_limits<double>::denorm_min()};
    return some[random_() % std::size(some)];
  }
  std::string bytes() {
    std::string out(wild() ? random_() % 300 : random_() % 6, 'a');
    for (char& c : out) c = static_cast<char>(wild() ? random_() : 'a' + random_() % 26);
    return out;
  }
  void set(google::protobuf::Message& m, const google::protobuf::Reflection& to, const Field& field) {
    const bool list = field.is_repeated();
    switch (field.cpp_type()) {
      case Field::CPPTYPE_INT32:
        return list ? to.AddInt32(&m, &field, static_cast<std::int32_t>(integer()))
                    : to.SetInt32(&m, &field, static_cast<std::int32_t>(integer()));
      case Field::CPPTYPE_INT64:
        return list ? to.AddInt64(&m, &field, integer()) : to.SetInt64(&m, &field, integer());
      case Field::CPPTYPE_UINT32:
        return list ? to.AddUInt32(&m, &field, static_cast<std::uint32_t>(integer()))
                    : to.SetUInt32(&m, &field, static_cast<std::uint32_t>(integer()));
      case Field::CPPTYPE_UINT64:
        return list ? to.AddUInt64(&m, &field, static_cast<std::uint64_t>(integer()))
                    : to.SetUInt64(&m, &field, static_cast<std::uint64_t>(integer()));
      case Field::CPPTYPE_DOUBLE:
        return list ? to.AddDouble(&m, &field, real()) : to.SetDouble(&m, &field, real());
      case Field::CPPTYPE_FLOAT:
        return list ? to.AddFloat(&m, &field, static_cast<float>(real())) : to.SetFloat(&m, &field, static_cast<float>(real()));
      case Field::CPPTYPE_BOOL:
        return to.SetBool(&m, &field, random_() % 2 == 0);
      case Field::CPPTYPE_ENUM:
        return to.SetEnumValue(&m, &field, static_cast<int>(integer()));
      case Field::CPPTYPE_STRING:
        return to.SetString(&m, &field, bytes());
      case Field::CPPTYPE_MESSAGE:
        return fill(list ? *to.AddMessage(&m, &field) : *to.MutableMessage(&m, &field));
    }
  }
  // What fields say of each other.
  void mend(google::protobuf::Message& message) {
    if (auto* hello = dynamic_cast<pb::Hello*>(&message)) {
      hello->set_protocol_version(1);
      hello->set_pacing(pb::PACING_FREE);
    } else if (auto* world = dynamic_cast<pb::World*>(&message)) {
      world->set_protocol_version(1);
      world->set_session("s");
      world->set_step_bits(lattice::kStepBits);
      world->set_horizon(1000);
      world->set_window(2);
    } else if (auto* pose = dynamic_cast<pb::Pose*>(&message)) {
      pose->set_sequence(pose->sequence() + 1);
      pose->set_vertical_fov(1);
      pose->set_width(pose->width() + 1);
      pose->set_height(pose->height() + 1);
    } else if (auto* moved = dynamic_cast<pb::Moved*>(&message)) {
      if (!moved->has_pose()) fill(*moved->mutable_pose());
    } else if (auto* leaf = dynamic_cast<pb::LeafWhole*>(&message)) {
      leaf->set_vertices(leaf->triangles() == 0 ? 0 : 3);
      leaf->set_payload(leaf->triangles() == 0 ? "" : "p");
    } else if (auto* clock = dynamic_cast<pb::SetClock*>(&message)) {
      clock->set_mode(pb::CLOCK_SCALED);
    } else if (auto* told = dynamic_cast<pb::Clock*>(&message)) {
      told->set_mode(pb::CLOCK_SCALED);
    } else if (auto* step = dynamic_cast<pb::Step*>(&message)) {
      step->set_time(step->time() + 1);
    } else if (auto* places = dynamic_cast<pb::Places*>(&message)) {
      *places->mutable_z() = places->x();
    } else if (auto* ray = dynamic_cast<pb::Ray*>(&message)) {
      ray->set_direction_z(-1);
    } else if (auto* ask = dynamic_cast<pb::AskGround*>(&message)) {
      ask->set_radius(10);
      ask->set_error(1);
    } else if (auto* map = dynamic_cast<pb::HeightMap*>(&message)) {
      map->set_pitch_x(std::uint64_t{1} << 30);
      map->set_pitch_z(std::uint64_t{1} << 28);
      map->set_width(map->width() + 2);
      map->set_height(map->height() + 2);
      map->set_highest(std::max(map->lowest(), map->highest()));
    } else if (auto* made = dynamic_cast<pb::Edited*>(&message)) {
      for (int k = 0; k < made->edits_size(); ++k) made->mutable_edits(k)->set_number(std::uint64_t{5} + static_cast<std::uint64_t>(k));
    } else if (auto* crowd = dynamic_cast<pb::Crowd*>(&message)) {
      *crowd->mutable_j() = crowd->i();
      crowd->clear_count();
      for (int k = 0; k < crowd->i_size(); ++k) crowd->add_count(static_cast<std::uint32_t>(integer()));
    } else if (auto* points = dynamic_cast<pb::Candidates*>(&message)) {
      points->clear_points();
      for (int k = 0; k < 3 * points->errors_size(); ++k) points->add_points(static_cast<std::int32_t>(integer()));
    } else if (auto* it = dynamic_cast<pb::Iteration*>(&message)) {
      it->set_number(it->number() + 1);
    }
  }

  std::mt19937_64 random_;
  std::uint64_t wildness_;
};

}  // namespace ridgecast::wire
