#include "common/edits/json.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>
#include <string>

#include "tests/support/sanitized.h"

namespace ridgecast::edits {
namespace {

TEST(EditJson, ComesBackAsItWas) {
  const std::vector<Operation> operations{
      {Raise{{-1, (lattice::Step{1} << 50)}, 333, 77, -1025}, 0},  {Raise{{-1, 3}, 333, 77, 1025}, 8},
      {Crater{{(lattice::Step{1} << 49) + 1, -5}, 12345, 3}, 1},   {Level{{{1, 2}}, 4097, -300, 77}, 2},
      {Level{{{1, 2}, {30001, 2}, {3, 9999}}, 0, 300, 77}, 0},     {Smooth{{3, 4}, 500, 16}, 3},
      {Road{{{1, 2, 0}, {3000, 4000, 0}}, false, 999, 5, 300}, 0}, {Road{{{1, 2, -7}, {3000, 4000, 8}}, true, 999, 5, 300}, 6},
      {Stamp{{3, 4}, 2, 3, 16, {1, -2, 3, -4, 5, 6}}, 0},          {Undo{123'456'789}, 0}};
  for (const Operation& o : operations) {
    const auto back = fromJson(toJson(o));
    ASSERT_TRUE(back) << toJson(o) << back.error().message;
    EXPECT_EQ(*back, o) << toJson(o);
  }
}

TEST(EditJson, IsWrittenAsALibraryWritesIt) {
  std::mt19937_64 random(7);
  for (int k = 0; k < testing_support::rounds(100'000); ++k) {
    // Within 8,000 km: farther away the library may find a number with fewer digits.
    const auto steps = [&] { return static_cast<lattice::Step>(random() >> (33 + random() % 31)) * (random() % 2 == 0 ? 1 : -1); };
    const Operation o{Crater{{steps(), steps()}, steps(), static_cast<std::int32_t>(steps() / 256)},
                      static_cast<std::uint32_t>(random() % 9)};
    ASSERT_EQ(nlohmann::json::parse(toJson(o)).dump(), toJson(o));
  }
}

TEST(EditJson, NamesWhatIsWrong) {
  const auto refusal = [](std::string_view text) {
    const auto o = fromJson(text);
    return o ? std::string() : o.error().message;
  };
  const auto has = [&](std::string_view text, std::string_view words) {
    EXPECT_NE(refusal(text).find(words), std::string::npos) << text << "\n" << refusal(text);
  };
  has("", "JSON object");
  has("[]", "JSON object");
  has(R"({"op":5})", "JSON object");
  has(R"({"op":"dig"})", "\"dig\"");
  has(R"({"op":"crater","x":0,"z":0,"radius":5})", "\"depth\" is missing");
  has(R"({"op":"crater","x":"0","z":0,"radius":5,"depth":1})", "\"x\" must be a number");
  has(R"({"op":"crater","x":1e300,"z":0,"radius":5,"depth":1})", "\"x\"");
  has(R"({"op":"crater","x":0,"z":0,"radius":5,"depth":1e9})", "\"depth\"");
  has(R"({"op":"crater","x":0,"z":0,"radius":5,"depth":1,"colour":3})", "no \"colour\"");
  has(R"({"op":"crater","x":0,"z":0,"radius":5,"depth":1,"material":"gold"})", "material");
  has(R"({"op":"level","polygon":[[0,0],[1],[2,2]],"height":0})", "\"polygon\"");
  has(R"({"op":"level","polygon":5,"height":0})", "\"polygon\"");
  has(R"({"op":"level","x":0,"z":0,"radius":5,"height":0,"slope":-1})", "\"slope\"");
  has(R"({"op":"road","line":[[0,0],[5,5,1]],"width":3})", "every place or at none");
  has(R"({"op":"road","line":[[0,0,1e9],[5,5,1]],"width":3})", "height");
  has(R"({"op":"stamp","x":0,"z":0,"columns":2,"samples":[1,2,3]})", "\"columns\"");
  has(R"({"op":"stamp","x":0,"z":0,"columns":2,"spacing":0.3,"samples":[1,2,3,4]})", "\"spacing\"");
  has(R"({"op":"stamp","x":0,"z":0,"columns":0,"samples":[]})", "\"columns\"");
  has(R"({"op":"undo","edit":1.5})", "whole number");
  has(R"({"op":"smooth","x":0,"z":0,"radius":5,"passes":1e12})", "passes");
  const std::string deep(100'000, '[');
  has(deep, "JSON object");
}

TEST(EditJson, NumbersAreCheckedBeforeTheyAreNarrowed) {
  const auto stamp = [](const std::string& spacing) {
    return fromJson(R"({"op":"stamp","x":0,"z":0,"columns":2,"samples":[1,2,3,4],"spacing":)" + spacing + "}");
  };
  ASSERT_TRUE(stamp("0.5"));
  for (const char* const spacing : {"2147483648.5", "-2147483647.5", "4294967296.5", "1e12", "8.5", "0", "-0.5"}) {
    const auto kept = stamp(spacing);
    EXPECT_FALSE(kept) << spacing << " m is kept as " << toJson(*kept);
  }
}

TEST(EditJson, EveryPrefixIsRefused) {
  const std::string whole = R"({"op":"road","line":[[0,0],[50,5],[60,-3]],"width":3,"material":"gravel"})";
  ASSERT_TRUE(fromJson(whole));
  for (std::size_t n = 0; n < whole.size(); ++n) EXPECT_FALSE(fromJson(std::string_view(whole).substr(0, n)));
}

}  // namespace
}  // namespace ridgecast::edits
