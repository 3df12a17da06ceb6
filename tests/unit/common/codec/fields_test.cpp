// Fields to bytes and back: what is written is read, and whatever else is said of bytes that nobody wrote, it is not taken.
#include "common/codec/fields.h"

#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace ridgecast::codec {
namespace {

using Bytes = std::vector<std::uint8_t>;

enum class Colour : std::uint8_t { kRed, kGreen, kBlue };
struct Thing {
  std::uint64_t number = 0;
  std::uint32_t part = 0;
  std::int64_t offset = 0;
  bool isThere = false;
  double share = 0;
  std::string name;
  Colour colour = Colour::kRed;
  std::uint64_t hash = 0;  // of which four bytes are kept
  std::vector<std::string> words;
  friend bool operator==(const Thing&, const Thing&) = default;
};

bool walk(auto& io, auto& v) {
  return io(v.number) && io(v.part) && io(v.offset) && io(v.isThere) && io(v.share) && io(v.name) && io.upTo(v.colour, 2) &&
         io.fixed(v.hash, 4) && io.list(v.words, [&](auto& word) { return io(word); });
}

Bytes written(const Thing& thing) {
  Bytes bytes;
  FieldWriter out(bytes);
  EXPECT_TRUE(walk(out, thing));
  return bytes;
}

bool reads(const Bytes& bytes, Thing& thing) {
  FieldReader in(bytes);
  return walk(in, thing) && in.isOver();
}

const Thing kThing{~std::uint64_t{0}, 0xffffffffu,  std::numeric_limits<std::int64_t>::min(), true, -0.1, "a name", Colour::kBlue,
                   0x89abcdefu,       {"", "words"}};

TEST(Fields, ComeBackAsTheyWereWritten) {
  for (const Thing& thing : {Thing(), kThing}) {
    Thing back;
    ASSERT_TRUE(reads(written(thing), back));
    EXPECT_EQ(back, thing);
  }
}

TEST(Fields, AreNotReadFromBytesThatAreCutOffOrTooMany) {
  Bytes bytes = written(kThing);
  Thing back;
  for (std::size_t n = 0; n < bytes.size(); ++n)
    EXPECT_FALSE(reads({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n)}, back)) << n;
  bytes.push_back(0);
  EXPECT_FALSE(reads(bytes, back));
}

TEST(Fields, HaveTheirRange) {
  const auto refuses = [](const Bytes& bytes, auto&& read) {
    FieldReader in(bytes);
    return !read(in);
  };
  EXPECT_TRUE(refuses({2}, [](FieldReader& in) { return in(*std::make_unique<bool>()); }));
  EXPECT_TRUE(refuses({0x80, 0x80, 0x80, 0x80, 0x10}, [](FieldReader& in) { return in(*std::make_unique<std::uint32_t>()); })) << "2^32";
  EXPECT_TRUE(refuses({3}, [](FieldReader& in) { return in.upTo(*std::make_unique<Colour>(), 2); }));
  EXPECT_TRUE(refuses({0, 0, 0, 0, 0, 0, 0xf0, 0x7f}, [](FieldReader& in) { return in(*std::make_unique<double>()); })) << "infinite";
  EXPECT_TRUE(refuses({100}, [](FieldReader& in) {
    std::vector<std::string> words;
    return in.list(words, [](std::string&) { return true; });
  })) << "more entries than bytes";
}

}  // namespace
}  // namespace ridgecast::codec
