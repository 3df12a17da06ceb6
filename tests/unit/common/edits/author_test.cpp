#include "common/edits/author.h"

#include <gtest/gtest.h>

#include <string>

namespace ridgecast::edits {
namespace {

TEST(Author, ComesBackAsItWas) {
  for (const Author& a : {Author{"token of lab", "ann"}, Author{"address 2001:db8::1", ""}, Author{"", "ann"}, Author{"", ""}})
    EXPECT_EQ(authorOf(toText(a)), a) << toText(a);
}

TEST(Author, OfALogWithoutNamesIsWhatStandsThere) { EXPECT_EQ(authorOf("ann"), (Author{"ann", ""})); }

TEST(Author, IsOnlyWhatClientsAccept) {
  const std::string most(kMaxAuthorBytes, 'a');
  EXPECT_EQ(authorOf(toText({most, most})), (Author{most, most}));
  EXPECT_EQ(authorOf(toText({most + "a", "ann"})), (Author{"", "ann"}));
  EXPECT_EQ(authorOf("token of lab\nann\nbob"), (Author{"token of lab", ""}));
  EXPECT_EQ(authorOf("a\x7f"), (Author{"", ""}));
}

}  // namespace
}  // namespace ridgecast::edits
