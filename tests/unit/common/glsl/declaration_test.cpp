// Summaries and parameters of terrain files.

#include "common/glsl/declaration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ridgecast::glsl {
namespace {

using testing::HasSubstr;

constexpr std::string_view kText =
    "//! hills\n"
    "//! of its own\n"
    "const float snowLine = 1800.0f;  //! 0..4000 m: height of the snow line\n"
    "  const  float bend=-1.5e-1;//! -2 .. 2 : how bent\n"
    "const float plain = 3.0;  // no parameter\n";

TEST(Declaration, readsSummaryAndParameters) {
  const auto d = readDeclaration("hills.glsl", kText);
  ASSERT_TRUE(d) << d.error().message;
  EXPECT_EQ(d->summary, "hills");
  ASSERT_EQ(d->parameters.size(), 2u);
  EXPECT_EQ(d->parameters[0].name, "snowLine");
  EXPECT_EQ(d->parameters[0].unit, "m");
  EXPECT_EQ(describe(d->parameters[0]), "snowLine = 1800 m (0..4000): height of the snow line");
  EXPECT_EQ(describe(d->parameters[1]), "bend = -0.15 (-2..2): how bent");
}

TEST(Declaration, withoutAssignmentsTheTextIsUnchanged) {
  EXPECT_EQ(withParameters("hills.glsl", kText, *readDeclaration("hills.glsl", kText), {}).value(), kText);
}

// Law: reading the changed text gives the values that were set, and nothing else has changed.
TEST(Declaration, assignmentsReplaceLiteralsAndNothingElse) {
  const auto before = readDeclaration("hills.glsl", kText).value();
  for (const double value : {0.0, 1.0, 0.1, 4000.0, 1e-9, 2999.5}) {
    const auto text = withParameters("hills.glsl", kText, before, {{"bend", 2}, {"snowLine", 7}, {"snowLine", value}, {"bend", -2}});
    ASSERT_TRUE(text) << text.error().message;
    const auto after = readDeclaration("hills.glsl", *text);
    ASSERT_TRUE(after) << after.error().message << *text;
    EXPECT_EQ(after->parameters[0].value, value);
    EXPECT_EQ(after->parameters[1].value, -2);
    auto back = withParameters("hills.glsl", *text, *after, {{"snowLine", 1800}, {"bend", -0.15}}).value();
    EXPECT_THAT(back, HasSubstr("const float plain = 3.0;  // no parameter\n"));
    EXPECT_THAT(back, HasSubstr("const float snowLine = 1800.0f;  //! 0..4000 m"));
  }
}

TEST(Declaration, refusesWhatIsNotDeclaredOrOutOfRange) {
  const auto d = readDeclaration("hills.glsl", kText).value();
  EXPECT_THAT(withParameters("hills.glsl", kText, d, {{"treeLine", 1}}).error().message,
              HasSubstr("no parameter 'treeLine'; it has: snowLine, bend"));
  EXPECT_THAT(withParameters("hills.glsl", kText, d, {{"snowLine", 4000.5}}).error().message, HasSubstr("from 0 to 4000 m"));
  EXPECT_THAT(withParameters("flat.glsl", "", {}, {{"a", 1}}).error().message, HasSubstr("it has none"));
}

TEST(Declaration, readsAssignments) {
  EXPECT_EQ(parseAssignment("a=1.5").value(), Assignment("a", 1.5));
  EXPECT_EQ(parseAssignment("a= -2e3 ").value(), Assignment("a", -2000));
  for (const char* wrong : {"", "a", "=1", "a=", "a=x", "a=1x", "a=inf", "a=nan", "a=1=2"})
    EXPECT_TRUE(parseAssignment(wrong).has_error()) << wrong;
}

TEST(Declaration, namesTheLineOfAWrongOne) {
  for (const char* wrong : {"const float a = 1.0; //! what it is", "const int a = 1; //! 0..2: a", "float a = 1.0; //! 0..2: a",
                            "const float a = b; //! 0..2: a", "const float a = 1.0; //! 0..two: a", "const float a = 3.0; //! 0..2: a",
                            "const float a = 1.0, b = 1.0; //! 0..2: a"}) {
    const auto d = readDeclaration("hills.glsl", std::string("// first\n") + wrong + "\n");
    ASSERT_TRUE(d.has_error()) << wrong;
    EXPECT_THAT(d.error().message, testing::StartsWith("hills.glsl:2: ")) << wrong;
  }
}

}  // namespace
}  // namespace ridgecast::glsl
