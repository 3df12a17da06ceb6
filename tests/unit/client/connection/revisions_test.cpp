// Peers of neighbouring revisions work together: what one does not know the other leaves out or says in a sentence.
#include <gtest/gtest.h>

#include <algorithm>
#include <future>
#include <set>
#include <vector>

#include "client/connection/connection.h"
#include "tests/unit/client/connection/raw_server.h"
#include "tests/unit/client/connection/talking.h"

namespace ridgecast::connection {
namespace {

using test::RawConnection;
using test::RawServer;
using testing_support::kTimeout;

std::string worldOf(std::uint32_t revision) { return worldBytes(3, wire::kProtocolVersion, revision); }

std::unique_ptr<Connection> opened(const RawServer& server) {
  auto connection = Connection::open(at(server.port()), {}, kTimeout);
  EXPECT_TRUE(connection) << connection.error().message;
  return connection ? std::move(*connection) : nullptr;
}

TEST(Revisions, ALaterServersNewsAreIgnored) {
  const std::string field("\xa2\x06\x03new", 6), kind("\x92\x7d\x02hi", 5);  // a field 100; a message with nothing but field 2002
  RawServer server([&](RawConnection& peer) {
    peer.upgrade();
    peer.readFrame();
    peer.sendFrame(worldOf(wire::kRevision + 1) + field);
    peer.sendFrame(kind);
    wire::Iteration iteration;
    iteration.number = 1;
    peer.sendFrame(wire::encode(wire::ServerMessage(iteration)) + field);
    peer.drain();
  });
  const auto connection = opened(server);
  ASSERT_TRUE(connection);
  EXPECT_EQ(connection->world().revision, wire::kRevision + 1);
  const auto received = connection->receive(kTimeout);
  ASSERT_TRUE(received) << (connection->error() ? connection->error()->message : "nothing came");
  EXPECT_EQ(received->iteration.number, 1u);
}

// Each revision's kinds of messages go to servers of this revision and later ones alone.
TEST(Revisions, AnEarlierServerIsNotToldWhatItDoesNotKnow) {
  const auto kindOf = [](const wire::ClientMessage& m) { return m.index(); };
  const std::vector<std::size_t> since{kindOf(wire::PoseMessage{}), kindOf(wire::Query{}), kindOf(wire::ChangeSettings{}),
                                       kindOf(wire::PassOver{}),    kindOf(wire::Edit{}),  kindOf(wire::FindEdits{})};
  for (std::uint32_t revision = 0; revision <= wire::kRevision; ++revision) {
    std::promise<std::set<std::size_t>> kinds;
    RawServer server([&](RawConnection& peer) {
      peer.upgrade();
      peer.readFrame();
      peer.sendFrame(worldOf(revision));
      std::set<std::size_t> seen;
      while (seen.size() < std::min<std::size_t>(revision + 1, since.size())) {
        const std::string frame = peer.readFrame();
        const auto message = wire::decodeClient({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()});
        if (!message) break;
        seen.insert(message->index());
      }
      kinds.set_value(seen);
      peer.drain();
    });
    const auto connection = opened(server);
    ASSERT_TRUE(connection);
    wire::Query query;
    query.x = query.z = {1};
    auto answer = connection->ask(query);
    connection->change({.threshold = 2});
    connection->passOver(7);
    connection->edit({});
    connection->find({});
    connection->send({.sequence = 1, .camera = {}});
    EXPECT_EQ(kinds.get_future().get(), std::set(since.begin(), since.begin() + std::min<std::ptrdiff_t>(revision + 1, std::ssize(since))))
        << revision;
    if (revision == 0) expectContains(answer.get().error().message, "is of a version that answers no queries");
  }
}

}  // namespace
}  // namespace ridgecast::connection
