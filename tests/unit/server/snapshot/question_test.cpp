#include "server/snapshot/question.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace ridgecast::snapshot {
namespace {

using namespace std::string_literals;

using testing::HasSubstr;

constexpr Limits kLimits;
constexpr char kPose[] = "x=1&z=-2&altitude=100&yaw=30&pitch=-10";

std::string refusal(const std::string& query) {
  const auto question = parse(query, kLimits);
  if (question) return "";
  EXPECT_TRUE(question.error().message.ends_with('.')) << question.error().message;
  EXPECT_LT(question.error().message.size(), 400u);
  return question.error().message;
}

TEST(Question, Poses) {
  const auto q = parse(kPose, kLimits);
  ASSERT_TRUE(q) << q.error().message;
  const auto& pose = std::get<OfPose>(q->of);
  EXPECT_EQ(pose.camera.pose.x, 256);
  EXPECT_EQ(pose.camera.pose.z, -512);
  EXPECT_EQ(pose.camera.pose.y, 100);
  EXPECT_TRUE(pose.aboveGround);
  EXPECT_DOUBLE_EQ(pose.camera.pose.yaw, std::numbers::pi / 6);
  EXPECT_EQ(pose.camera.projection.width, 1280u);
  EXPECT_EQ(pose.threshold, 0.6);
  EXPECT_TRUE(q->attributes.normals && q->attributes.colours && !q->attributes.materials && q->compression == gltf::Compression::kNone);
  const auto other =
      parse("x=1e12&z=0&y=900&yaw=0&pitch=0&fov=45&width=640&height=360&threshold=2&compression=draco&normals=0&colours=0", kLimits);
  ASSERT_TRUE(other);
  EXPECT_FALSE(std::get<OfPose>(other->of).aboveGround || other->attributes.normals || other->attributes.colours);
  EXPECT_EQ(std::get<OfPose>(other->of).camera.pose.x, 256'000'000'000'000);
  EXPECT_EQ(other->compression, gltf::Compression::kDraco);
}

TEST(Question, CamerasAndBoxes) {
  EXPECT_EQ(std::get<OfCamera>(parse("camera=7", kLimits)->of).id, 7u);
  const auto box = std::get<OfBox>(parse("x0=-10.5&z0=0&x1=20&z1=30&error=0.5", kLimits)->of);
  EXPECT_EQ(box.low, (lattice::Point{-2688, 0}));
  EXPECT_EQ(box.high, (lattice::Point{5120, 7680}));
  EXPECT_EQ(box.error, 0.5);
}

TEST(Question, OriginAndTexture) {
  EXPECT_EQ(parse(kPose, kLimits)->origin, Origin::kCell);
  EXPECT_EQ(parse(std::string(kPose) + "&origin=centre", kLimits)->origin, Origin::kCentre);
  EXPECT_THAT(refusal(std::string(kPose) + "&origin=middle"), HasSubstr("must be cell, centre or world"));
  const std::string box = "x0=0&z0=0&x1=20&z1=30&error=0.5";
  EXPECT_EQ(parse(box, kLimits)->texture, 0u);
  const auto painted = parse(box + "&texture=1024", kLimits);
  EXPECT_EQ(painted->texture, 1024u);
  EXPECT_FALSE(painted->attributes.colours) << "of vertices";
  for (const char* wrong : {"8", "4097", "x"}) EXPECT_THAT(refusal(box + "&texture=" + wrong), HasSubstr("from 16 to 4096 pixels"));
  EXPECT_THAT(refusal(box + "&texture=64&compression=draco"), HasSubstr("compression=none"));
  EXPECT_THAT(refusal(std::string(kPose) + "&texture=64"), HasSubstr("'texture', which does not belong here"));
  EXPECT_EQ(canonical(*parse(box + "&origin=cell", kLimits)), canonical(*parse(box, kLimits)));
  EXPECT_NE(canonical(*parse(box + "&origin=world", kLimits)), canonical(*parse(box, kLimits)));
  EXPECT_NE(canonical(*painted), canonical(*parse(box + "&texture=512", kLimits)));
  EXPECT_EQ(parse(box, kLimits, nullptr, Format::kObj)->format, Format::kObj);
  for (const char* more : {"&texture=64", "&compression=draco", "&materials=1"})
    EXPECT_THAT(parse(box + more, kLimits, nullptr, Format::kPly).error().message, HasSubstr("no compression, texture or materials"));
  EXPECT_TRUE(parse(box + "&up=z", kLimits, nullptr, Format::kObj)->isZUp);
  EXPECT_FALSE(parse(box + "&up=y", kLimits)->isZUp);
  EXPECT_NE(canonical(*parse(box + "&up=z", kLimits, nullptr, Format::kPly)), canonical(*parse(box, kLimits, nullptr, Format::kPly)));
  EXPECT_THAT(refusal(box + "&up=z"), HasSubstr("glTF has y up"));
  EXPECT_THAT(refusal(box + "&up=x"), HasSubstr("it must be y or z"));
  EXPECT_EQ(formatOf("a.ply"), Format::kPly);
  EXPECT_EQ(formatOf("a.gltf"), std::nullopt);
}

TEST(Question, RefusalsSayWhichLimitAndWhatWouldFit) {
  EXPECT_THAT(refusal(""), HasSubstr("lacks 'x'"));
  EXPECT_THAT(refusal("x=nan&z=0&altitude=1&yaw=0&pitch=0"), HasSubstr("'x' is 'nan'; it must be a number from"));
  for (const char* bad : {"inf", "-inf", "1e999", "0x10", "1,5", "", " 1", "1 ", "1e13", "--1"})
    EXPECT_THAT(refusal("x=" + std::string(bad) + "&z=0&altitude=1&yaw=0&pitch=0"), HasSubstr("number from")) << bad;
  EXPECT_THAT(refusal(std::string(kPose) + "&threshold=0.001"), HasSubstr("0.05 to 1000 pixels"));
  EXPECT_THAT(refusal(std::string(kPose) + "&width=100000"), HasSubstr("16 to 16384"));
  EXPECT_THAT(refusal(std::string(kPose) + "&y=1"), HasSubstr("both"));
  EXPECT_THAT(refusal(std::string(kPose) + "&compression=zip"), HasSubstr("draco or none"));
  EXPECT_THAT(refusal(std::string(kPose) + "&color=1"), HasSubstr("'color'"));
  EXPECT_THAT(refusal(std::string(kPose) + "&x=1"), HasSubstr("twice"));
  EXPECT_THAT(refusal("x=%zz"), HasSubstr("hexadecimal"));
  EXPECT_THAT(refusal("camera=0"), HasSubstr("whole number"));
  EXPECT_THAT(refusal("camera=-1"), HasSubstr("whole number"));
  EXPECT_THAT(refusal("camera=1&x=1"), HasSubstr("does not belong"));
  EXPECT_THAT(refusal("x0=0&z0=0&x1=100000&z1=1&error=1"), HasSubstr("1 to 32768 m"));
  EXPECT_THAT(refusal("x0=5&z0=0&x1=1&z1=9&error=1"), HasSubstr("must be 1 to"));
  EXPECT_THAT(refusal("x0=0&z0=0&x1=9&z1=9&error=0"), HasSubstr("0.02 to 1000 m"));
  EXPECT_THAT(refusal("x0=0&z0=0&x1=9&z1=9"), HasSubstr("lacks 'error'"));
  std::string many;
  for (int k = 0; k < 100; ++k) many += "a" + std::to_string(k) + "&";
  EXPECT_THAT(refusal(many), HasSubstr("32 parameters"));
  EXPECT_THAT(refusal("x=%3Cscript%3E%00%0d%0aSet-Cookie"),
              testing::Not(testing::AnyOf(HasSubstr("\r"), HasSubstr("\n"), HasSubstr(std::string(1, '\0')))));
}

TEST(Question, TheSameQuestionHasOneText) {
  EXPECT_EQ(canonical(*parse(kPose, kLimits)),
            canonical(*parse("pitch=-10.0&yaw=3e1&altitude=%31%30%30&z=-2.000&x=1&fov=60&threshold=0.60", kLimits)));
  const std::string base = canonical(*parse(kPose, kLimits));
  for (const char* more : {"&fov=61", "&width=1281", "&height=719", "&threshold=0.61", "&colour_error=0.2", "&compression=draco",
                           "&normals=0", "&colours=0", "&materials=1"})
    EXPECT_NE(canonical(*parse(std::string(kPose) + more, kLimits)), base) << more;
}

TEST(Question, AnyBytesAreAnsweredInOneSentence) {
  std::mt19937 random(3);
  const std::string letters = "xzy01=&%+-.einfa\n\0<>'\""s;
  for (int k = 0; k < 20'000; ++k) {
    std::string query(random() % 60, ' ');
    for (char& c : query) c = random() % 4 ? letters[random() % letters.size()] : static_cast<char>(random());
    refusal(query);
  }
}

}  // namespace
}  // namespace ridgecast::snapshot
