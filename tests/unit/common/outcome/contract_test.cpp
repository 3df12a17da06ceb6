#include "common/outcome/contract.h"

#include <gtest/gtest.h>

namespace ridgecast {
namespace {

TEST(Contract, SaysWhichIsBrokenAndWhereAndEnds) {
  expects(true, "all is well");
  EXPECT_DEATH(expects(false, "a range begins before it ends"),
               "a contract is broken: a range begins before it ends \\(contract_test.cpp, line [0-9]+\\)");
}

}  // namespace
}  // namespace ridgecast
