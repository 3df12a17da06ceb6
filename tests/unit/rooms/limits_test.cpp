// Every row of the table *Limits* of server/README.md has a test. A row that is not here, or a name that no test's source has, fails.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace ridgecast {
namespace {

namespace fs = std::filesystem;

// What a row begins with, and the tests of all that it names.
const std::map<std::string, std::vector<std::string>> kTests{
    {"`max-connections`, ", {"ConnectionsAndCamerasAreBounded", "ConnectionsOfOneAddressAndOfThoseBehindAProxy"}},
    {"`max-header-bytes`", {"RefusesWhatIsNoHttp"}},
    {"`max-cameras`, ", {"PlacesAreBoundedAndGivenBack", "ThereAreOnlySoManyAndIdleOnesEnd"}},
    {"`max-members`", {"PlacesAreBoundedAndGivenBack", "MembersCountAndAreSentAwayOverAllServers"}},
    {"`max-total-triangles`", {"CamerasAreGrantedWhatIsLeftOfAllTriangles", "EverybodyFliesOnASmallServerAndTheNextIsRefused"}},
    {"`max-triangles`", {"HelloIsAnsweredWithTheWorldAndWhatWasGranted"}},
    {"memory runs out", {"WhatRunsOutEndsCamerasAndNotTheServer"}},
    {"`max-sessions-per-client`", {"AreByTokenHolderOrAddress"}},
    {"`max-message-bytes`", {"MessagesHaveASizeAndPingsARate"}},
    {"`max-messages-per-second`", {"MessagesHaveASizeAndPingsARate", "WhoSaysMoreThanIsReadInASecondWaits"}},
    {"bytes of messages", {"BytesOfMessagesHaveABudgetForAllStreamsOfAClient"}},
    {"`timeout`", {"SilentClientsAreClosed"}},
    {"`idle`", {"SilentClientsAreClosed"}},
    {"5 minutes without an acknowledgement", {"WhoNeverAcknowledgesIsToldSo"}},
    {"30 s for a member", {"AMemberThatNeverSaysDoneIsPassedOverAndTold"}},
    {"`session-idle`", {"SessionsEndWhenTheyWereEmptyForLongEnough", "SessionsInWhichNobodySaidHelloEndWithinSeconds"}},
    {"height maps and their pictures in use", {"TerrainsOfOneMapShareItsSamples"}},
    {"leaves requested again", {"AHundredResendsSendAtMostThreeMeshes", "RepairsOnManyConnectionsOfOneClientHaveOneBudget"}},
    {"open at a time",
     {"OnlySoManyAreOpen", "OnlySoManyAtATimeAndNoneAfterTheEnd", "waitForRoomAndAreBounded", "QueuedStepsAreBoundedAndGoWithTheirOwner",
      "LockstepBoundsItsQueue"}},
    {"edits: ",
     {"HostileOnesAreRefusedAndDisturbNobody", "WhatWaitsIsBounded", "AreTakenWhenAskedAndGivenBack", "BytesOfEditsHaveABudget"}},
    {"room for edits", {"MemoryIsBounded", "AreTakenWhenAskedAndGivenBack", "OfOnlySoManySessionsAreKept", "OneBeginsHalfOfTheLogs"}},
    {"bounds of the ground", {"KeepsTheLastUsedAndNoMore", "ManyKeepLittleMoreThanAFew"}},
    {"edits that are told", {"WaitForWhoDoesNotReadAndAreCodedOnceForAll", "ThatNobodyReadsTakeNoRoom"}},
    {"`max-heights-per-second`",
     {"WhatExceedsAMembersBudgetWaits", "ManyConnectionsOfOneClientHaveOneBudget", "LongRaysLeaveOthersTheirTurns",
      "WhoAsksForMuchPaysFromItsBudget"}},
    {"bodies of posted queries", {"OneClientHasHalfOfTheRoomForBodies", "OfTooManyBytesAreRefusedUnread"}},
    {"requests that wait", {"OneAskerLeavesPlacesToOthers", "OneClientHasHalfOfThePlaces"}},
    {"`snapshot-share`", {"WhoRestsKeepsToItsShare", "MakesSnapshotsToo"}},
    {"`max-snapshot-triangles`, ", {"WhatCannotBeSaysWhy", "OriginAndTexture"}},
    {"`cache-memory`", {"HoldsSoManyBytesAndTheLastWanted"}},
    {"tilesets: ", {"RefusesTheRestInPlainWords"}},
    {"`snapshot --tiles`", {"TooManyNameTheErrorThatFits"}},
    {"a token in the URL", {"ATokenInTheUrlOfATilesetExpiresSoon"}},
    {"iterations of more than 10 ms", {"ShortTasksDoNotWaitForLongOnes"}},
    {"grounds: ", {"FewerAreInWorkThanThereAreThreads", "AQuestionHasOneDeadline"}},
};

TEST(Limits, EachRowHasATest) {
  const fs::path root(RIDGECAST_SOURCE);
  std::string tests;
  for (const auto& entry : fs::recursive_directory_iterator(root / "tests"))
    if (entry.path().filename().string().ends_with("_test.cpp") && entry.path().filename() != "limits_test.cpp")
      tests += testing_support::readText(entry.path());
  std::istringstream lines(testing_support::readText(root / "server/README.md"));
  std::set<std::string> seen;
  bool isThere = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("## ")) isThere = line == "## Limits";
    if (!isThere || !line.starts_with("| ") || line.starts_with("| setting")) continue;
    const auto row = std::ranges::find_if(kTests, [&](const auto& entry) { return line.starts_with("| " + entry.first); });
    ASSERT_NE(row, kTests.end()) << "this row names no test: " << line;
    seen.insert(row->first);
    for (const std::string& name : row->second) EXPECT_NE(tests.find(", " + name + ")"), std::string::npos) << "there is no test " << name;
  }
  for (const auto& [row, names] : kTests) EXPECT_TRUE(seen.contains(row)) << "this row is gone: " << row;
}

}  // namespace
}  // namespace ridgecast
