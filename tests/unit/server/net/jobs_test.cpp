#include "server/http/jobs.h"
#include "server/http/snapshots.h"
#include "server/logging/logging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <ctime>
#include <functional>
#include <future>
#include <thread>
#include <vector>

#include "server/net/server.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast::net {
namespace {

using namespace ridgecast::http;

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using testing_support::SocketClient;
using Next = std::optional<RetryAt>;

template <class Condition>
bool soon(const Condition& condition) {
  return testing_support::await(condition);
}

// A job of one turn.
bool give(Jobs& jobs, std::stop_source stop, std::function<void(std::stop_token)> run, std::string client = {}) {
  const auto once = [run = std::move(run)](std::stop_token token) -> Next {
    run(std::move(token));
    return {};
  };
  return jobs.post(std::move(stop), once, std::move(client));
}

TEST(Jobs, RunWhatTheyTakeAndRefuseTheRest) {
  Jobs jobs({.threads = 2, .waiting = 3});
  std::promise<void> gate;
  const std::shared_future<void> open = gate.get_future().share();
  std::atomic<int> done{0};
  int taken = 0;
  for (int k = 0; k < 20; ++k)
    taken += give(jobs, std::stop_source(), [&](std::stop_token) {
      open.wait();
      ++done;
    });
  EXPECT_GE(taken, 3);
  EXPECT_LE(taken, 5);  // two run, three wait
  gate.set_value();
  EXPECT_TRUE(soon([&] { return done == taken; }));
  EXPECT_TRUE(give(jobs, std::stop_source(), [&](std::stop_token) { throw std::runtime_error("on purpose"); }));
  EXPECT_TRUE(give(jobs, std::stop_source(), [&](std::stop_token) { ++done; }));
  EXPECT_TRUE(soon([&] { return done == taken + 1; }));
}

TEST(Jobs, RunInTurnsAndKeepTheirPlacesBetweenThem) {
  Jobs jobs({.threads = 1, .waiting = 2});
  std::promise<void> gate;
  const std::shared_future<void> open = gate.get_future().share();
  std::vector<char> order;  // of the one thread's
  std::atomic<int> ended{0};
  Jobs::Clock::time_point due;
  ASSERT_TRUE(jobs.post(std::stop_source(), [&](std::stop_token) -> Next {
    open.wait();
    order.push_back('l');
    if (std::ranges::count(order, 'l') == 1) return RetryAt{Jobs::Clock::now()};
    if (std::ranges::count(order, 'l') == 2) return RetryAt{due = Jobs::Clock::now() + 50ms};
    EXPECT_GE(Jobs::Clock::now(), due);
    ++ended;
    return {};
  }));
  ASSERT_TRUE(soon([&] { return jobs.waiting() == 0; }));
  const auto brief = [&](std::stop_token) {
    order.push_back('b');
    ++ended;
  };
  ASSERT_TRUE(give(jobs, std::stop_source(), brief));
  ASSERT_TRUE(give(jobs, std::stop_source(), brief));
  gate.set_value();
  EXPECT_TRUE(soon([&] { return ended == 3; }));
  jobs.stop();
  EXPECT_EQ(std::string(order.begin(), order.end()), "lbbll");
}

TEST(Jobs, OneThatWaitsForItsNextTurnIsAbandonedLikeAnyOther) {
  Jobs jobs({.threads = 1, .waiting = 0});
  std::stop_source asker;
  std::atomic<int> turns{0};
  ASSERT_TRUE(jobs.post(asker, [&](std::stop_token) -> Next {
    ++turns;
    return RetryAt{Jobs::Clock::now() + 1h};
  }));
  ASSERT_TRUE(soon([&] { return turns == 1 && jobs.waiting() == 1; }));
  EXPECT_FALSE(give(jobs, std::stop_source(), [](std::stop_token) {})) << "it keeps the only place";
  asker.request_stop();
  std::atomic<bool> ran{false};
  EXPECT_TRUE(give(jobs, std::stop_source(), [&](std::stop_token) { ran = true; }));
  EXPECT_TRUE(soon([&] { return ran.load(); }));
  EXPECT_EQ(turns, 1);
}

// Woken while it waits, or before its turn has ended.
TEST(Jobs, OneThatWaitsForSomebodyElseIsWoken) {
  Jobs jobs({.threads = 1, .waiting = 2});
  const std::stop_source first, second;
  std::atomic<int> turns{0};
  std::promise<void> isOver;
  ASSERT_TRUE(jobs.post(first, [&](std::stop_token) -> Next { return ++turns == 1 ? Next(RetryAt{RetryAt::kWhenWoken}) : Next(); }));
  ASSERT_TRUE(soon([&] { return turns == 1 && jobs.waiting() == 1; }));
  std::atomic<int> others{0};
  ASSERT_TRUE(jobs.post(second, [&](std::stop_token) -> Next {
    if (++others == 2) return isOver.set_value(), Next();
    jobs.wake(second);
    return RetryAt{RetryAt::kWhenWoken};
  }));
  isOver.get_future().wait();
  EXPECT_EQ(turns, 1) << "nobody has woken it";
  jobs.wake(std::stop_source());
  jobs.wake(first);
  EXPECT_TRUE(soon([&] { return turns == 2 && jobs.waiting() == 0; }));
  jobs.wake(first);
}

TEST(Jobs, WhoHasItsAnswerMayAskAgainAtOnce) {
  const std::stop_source first;
  std::promise<void> has, gate;             // which outlive the job
  Jobs jobs({.threads = 1, .waiting = 1});  // a share of one
  ASSERT_TRUE(give(
      jobs, first,
      [&](std::stop_token) {
        EXPECT_FALSE(give(
            jobs, std::stop_source(), [](std::stop_token) {}, "a"));
        jobs.answered(first);
        has.set_value();
        gate.get_future().wait();  // its thread is not done with it
      },
      "a"));
  has.get_future().wait();
  EXPECT_TRUE(give(
      jobs, std::stop_source(), [](std::stop_token) {}, "a"));
  gate.set_value();
}

TEST(Jobs, ClientsTakeTurns) {
  Jobs jobs({.threads = 1, .waiting = 12});
  std::promise<void> gate;
  const std::shared_future<void> open = gate.get_future().share();
  ASSERT_TRUE(give(jobs, std::stop_source(), [&](std::stop_token) { open.wait(); }));
  ASSERT_TRUE(soon([&] { return jobs.waiting() == 0; }));
  std::string order;  // of the one thread's
  const auto ask = [&](const std::string& client) {
    return give(
        jobs, std::stop_source(), [&, client](std::stop_token) { order += client; }, client);
  };
  for (const char* client : {"a", "a", "a", "a", "b", "b", "c"}) ASSERT_TRUE(ask(client));
  gate.set_value();
  jobs.finish(Jobs::Clock::now() + testing_support::kTimeout);
  EXPECT_EQ(order, "abcabaa");
}

TEST(Jobs, KnowWhoIsNextAndHowLongItTakes) {
  Jobs jobs({.threads = 1, .waiting = 3});
  const auto take = [&](std::shared_future<void> open) {
    std::stop_source source;
    EXPECT_TRUE(give(jobs, source, [open = std::move(open)](std::stop_token) { open.wait(); }));
    return source;
  };
  EXPECT_EQ(jobs.secondsToWait(), 1);
  std::promise<void> slow, gate;
  const auto slowOpen = slow.get_future().share(), open = gate.get_future().share();
  const std::stop_source first = take(slowOpen);
  ASSERT_TRUE(soon([&] { return jobs.waiting() == 0; }));
  const std::stop_source second = take(open), third = take(open);
  EXPECT_EQ(jobs.ahead(first), 0);
  EXPECT_EQ(jobs.ahead(second), 1);
  EXPECT_EQ(jobs.ahead(third), 2);
  std::this_thread::sleep_for(1200ms);
  slow.set_value();
  ASSERT_TRUE(soon([&] { return jobs.ahead(second) == 0; }));
  EXPECT_EQ(jobs.ahead(third), 1);
  EXPECT_GE(jobs.secondsToWait(), 3);  // two of more than a second
  EXPECT_LE(jobs.secondsToWait(), 600);
  gate.set_value();
}

TEST(Jobs, WhatIsAbandonedMakesRoomAndNeverBegins) {
  std::promise<void> gate, began;
  Jobs jobs({.threads = 1, .waiting = 1});
  ASSERT_TRUE(give(jobs, std::stop_source(), [&](std::stop_token) {
    began.set_value();
    gate.get_future().wait();
  }));
  began.get_future().wait();
  std::atomic<bool> ran{false}, second{false};
  std::stop_source asker;
  ASSERT_TRUE(give(jobs, asker, [&](std::stop_token) { ran = true; }));
  EXPECT_FALSE(give(jobs, std::stop_source(), [](std::stop_token) {}));
  asker.request_stop();
  EXPECT_TRUE(give(jobs, std::stop_source(), [&](std::stop_token) { second = true; }));
  gate.set_value();
  EXPECT_TRUE(soon([&] { return second.load(); }));
  EXPECT_FALSE(ran);
}

TEST(Jobs, OneClientHasHalfOfThePlaces) {
  Jobs jobs({.threads = 1, .waiting = 5});
  ASSERT_EQ(jobs.share(), 3u);
  std::promise<void> gate;
  const std::shared_future<void> open = gate.get_future().share();
  const auto post = [&](const std::string& client) {
    return give(
        jobs, std::stop_source(), [open](std::stop_token) { open.wait(); }, client);
  };
  int greedy = 0;
  for (int k = 0; k < 10; ++k) greedy += post("address 192.0.2.1");
  EXPECT_EQ(greedy, 3);
  EXPECT_TRUE(jobs.hasShare("address 192.0.2.1"));
  EXPECT_TRUE(post("address 192.0.2.2"));
  EXPECT_TRUE(post("token of lab"));
  gate.set_value();
  EXPECT_TRUE(soon([&] { return !jobs.hasShare("address 192.0.2.1"); }));
  EXPECT_TRUE(soon([&] { return post("address 192.0.2.1"); }));
}

TEST(Jobs, FinishingLetsThemEndUntilTheTimeIsUp) {
  Jobs jobs({.threads = 1, .waiting = 4});
  std::atomic<int> done{0};
  std::promise<void> gate;
  const std::shared_future<void> open = gate.get_future().share();
  for (int k = 0; k < 3; ++k)
    give(jobs, std::stop_source(), [&](std::stop_token) {
      open.wait();
      std::this_thread::sleep_for(20ms);
      ++done;
    });
  EXPECT_GE(jobs.waiting(), 2u);
  gate.set_value();
  jobs.finish(std::chrono::steady_clock::now() + testing_support::kTimeout);
  EXPECT_EQ(done, 3);
  EXPECT_EQ(jobs.waiting(), 0u);
  EXPECT_FALSE(give(jobs, std::stop_source(), [](std::stop_token) {}));

  Jobs endless({.threads = 1, .waiting = 4});
  std::atomic<int> began{0};
  for (int k = 0; k < 2; ++k)
    give(endless, std::stop_source(), [&](std::stop_token stop) {
      ++began;
      while (!stop.stop_requested()) std::this_thread::sleep_for(1ms);
    });
  EXPECT_TRUE(soon([&] { return began == 1; }));
  endless.finish(std::chrono::steady_clock::now() + 50ms);
  EXPECT_EQ(began, 1);
}

TEST(Jobs, StoppingStopsThoseThatRun) {
  Jobs jobs({.threads = 2, .waiting = 4});
  std::atomic<int> began{0}, ended{0};
  for (int k = 0; k < 4; ++k)
    give(jobs, std::stop_source(), [&](std::stop_token stop) {
      ++began;
      while (!stop.stop_requested()) std::this_thread::sleep_for(1ms);
      ++ended;
    });
  EXPECT_TRUE(soon([&] { return began == 2; }));
  jobs.stop();
  EXPECT_EQ(ended, 2);
  EXPECT_FALSE(give(jobs, std::stop_source(), [](std::stop_token) {}));
}

// Routes whose answers come of work, over real sockets.
class LaterTest : public testing::Test {
 protected:
  void SetUp() override {
    logging::setUp(logging::Format::kText, logging::Level::kOff);
    settings.port = 0;
    settings.maxConnections = kMaxConnections;
    settings.patientJobs = {1, 3, 0};
    settings.trustedProxies = {access::Network::parse("127.0.0.0/8").value()};
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 1).value());
    server =
        Server::listen(
            settings, directory,
            {[this](const Request& r) { return route(r); },
             snapshotRoute(directory, {std::make_shared<snapshot::Snapshots>(snapshots, 1, &executor), std::make_shared<AnswerCache>(0)})})
            .value();
  }
  void TearDown() override { server->shutdown(); }
  std::optional<Reply> route(const Request& request) {
    DeferredResponse later;
    if (request.target == "/prompt") {
      later.unchanged.etag = "v1";
      later.work = [this](const Turn&) {
        ++worked;
        Answer made;
        made.body = "made\n";
        made.etag = "v1";
        return made;
      };
    } else if (request.target == "/large") {
      later.queue = Queue::kPatient;
      later.work = [](const Turn&) {
        Answer made;
        made.body.assign(30'000'000, 'x');
        return made;
      };
    } else if (request.target == "/endless") {
      ++asked;
      later.queue = Queue::kPatient;
      later.work = [this](const Turn& turn) {
        ++began;
        while (!turn.stop.stop_requested()) std::this_thread::sleep_for(1ms);
        ++ended;
        return Answer{};
      };
    } else if (request.target == "/world") {
      later.queue = Queue::kWorlds;
      later.work = [](const Turn&) {
        Answer made;
        made.body = "a world\n";
        return made;
      };
    } else if (request.target == "/tile") {
      later.queue = Queue::kTiles;
      later.work = [](const Turn&) {
        Answer made;
        made.body = "a tile\n";
        return made;
      };
    } else if (request.target == "/throws") {
      later.work = [](const Turn&) -> Answer { throw std::runtime_error("on purpose"); };
    } else {
      return std::nullopt;
    }
    return later;
  }
  static std::string get(std::string_view target, std::string_view more = "", std::string_view method = "GET") {
    return std::string(method) + " " + std::string(target) + " HTTP/1.1\r\nHost: localhost\r\n" + std::string(more) + "\r\n";
  }
  std::string ask(const std::string& request, bool hasBody = true) {
    SocketClient client(server->port());
    client.send(request);
    return client.answer(hasBody);
  }

  static constexpr int kMaxConnections = 8;
  scheduling::Executor executor{1};
  Settings settings;
  snapshot::Limits snapshots{.triangles = 20'000'000, .seconds = 600};
  std::shared_ptr<directory::Directory> directory;
  std::unique_ptr<Server> server;
  std::atomic<int> worked{0}, asked{0}, began{0}, ended{0};
};

TEST_F(LaterTest, WorldsAndTilesDoNotWaitForSnapshots) {
  SocketClient long1(server->port()), long2(server->port());
  long1.send(get("/endless"));
  long2.send(get("/endless"));
  EXPECT_TRUE(soon([&] { return began == 1 && asked == 2; }));
  EXPECT_THAT(ask(get("/world")), HasSubstr("a world\n"));
  EXPECT_THAT(ask(get("/tile")), HasSubstr("a tile\n"));
  EXPECT_EQ(ended, 0);
}

TEST_F(LaterTest, AnswersComeInOrderOnOneConnection) {
  SocketClient client(server->port());
  for (int k = 0; k < 3; ++k) {
    client.send(get("/prompt"));
    EXPECT_THAT(client.answer(), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("ETag: \"v1\""), HasSubstr("\r\n\r\nmade\n")));
  }
  client.send(get("/prompt") + get("/healthz") + get("/prompt"));  // all at once
  EXPECT_THAT(client.answer(), HasSubstr("made\n"));
  EXPECT_THAT(client.answer(), HasSubstr("ok\n"));
  EXPECT_THAT(client.answer(), HasSubstr("made\n"));
  client.send(get("/prompt", "", "HEAD"));
  EXPECT_THAT(client.answer(false), AllOf(HasSubstr("Content-Length: 5"), Not(HasSubstr("made"))));
  EXPECT_THAT(ask(get("/throws")), StartsWith("HTTP/1.1 500"));
}

TEST_F(LaterTest, WhoHasItAlreadyCostsNoWork) {
  for (const char* has : {"If-None-Match: \"v1\"\r\n", "If-None-Match: \"v0\", W/\"v1\"\r\n", "If-None-Match: *\r\n"}) {
    const std::string answer = ask(get("/prompt", has), false);
    EXPECT_THAT(answer,
                AllOf(StartsWith("HTTP/1.1 304"), HasSubstr("ETag: \"v1\""), Not(HasSubstr("made")), Not(HasSubstr("Content-Type:"))));
  }
  EXPECT_EQ(worked, 0);
  EXPECT_THAT(ask(get("/prompt", "If-None-Match: v1\r\n")), HasSubstr("made"));
  EXPECT_EQ(worked, 1);
}

TEST_F(LaterTest, LongAnswersArriveWhole) {
  const std::string answer = ask(get("/large"));
  ASSERT_GT(answer.size(), 30'000'000u);
  EXPECT_EQ(answer.substr(answer.size() - 30'000'000).find_first_not_of('x'), std::string::npos);
}

TEST_F(LaterTest, OneAskerLeavesPlacesToOthers) {
  const auto by = [](int who) { return "X-Forwarded-For: 192.0.2." + std::to_string(who) + "\r\n"; };
  std::vector<std::unique_ptr<SocketClient>> open;
  const auto wait = [&](int who, std::size_t waiting) {
    open.push_back(std::make_unique<SocketClient>(server->port()));
    open.back()->send(get("/endless", by(who)));
    EXPECT_TRUE(soon([&] { return static_cast<std::size_t>(asked) == waiting; }));
    std::this_thread::sleep_for(300ms);  // it is in the queue a moment later
  };
  wait(1, 1);
  wait(1, 2);
  EXPECT_THAT(ask(get("/large", by(1))), AllOf(StartsWith("HTTP/1.1 429"), HasSubstr("Retry-After: "),
                                               HasSubstr("address 192.0.2.1 waits for 2 answers of this kind, the most one client may")));
  wait(2, 3);
  wait(3, 4);
  EXPECT_THAT(ask(get("/large", by(4))), AllOf(StartsWith("HTTP/1.1 503"), HasSubstr("Retry-After: ")));
  EXPECT_THAT(ask(get("/prompt", by(1))), HasSubstr("made"));  // another queue
  open.clear();
  EXPECT_TRUE(soon([&] { return ask(get("/large", by(1))).starts_with("HTTP/1.1 200"); }));
  EXPECT_LE(began, 4);
}

// A snapshot of minutes: after its client is gone, the next one does not wait for it.
TEST_F(LaterTest, WhoHangsUpStopsHisSnapshot) {
  {
    SocketClient client(server->port());
    client.send(get("/v1/sessions/default/snapshot.glb?x0=-16000&z0=-16000&x1=16000&z1=16000&error=0.02", "Prefer: progress\r\n"));
    for (std::string said; said.find("Progress: meshing") == std::string::npos;) {
      said = client.answer(false);
      ASSERT_THAT(said, StartsWith("HTTP/1.1 102"));
    }
  }
  const auto cpuSeconds = [] {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  };
  const double before = cpuSeconds();
  EXPECT_THAT(ask(get("/v1/sessions/default/snapshot.glb?x0=0&z0=0&x1=64&z1=64&error=1")), StartsWith("HTTP/1.1 200"));
  EXPECT_LT(cpuSeconds() - before, 5) << "it was made for nobody";
}

TEST_F(LaterTest, WhoHangsUpBeforeHisTurnLeavesNoConnection) {
  SocketClient first(server->port());
  first.send(get("/endless"));
  ASSERT_TRUE(soon([&] { return began == 1; }));
  for (int k = 1; k < kMaxConnections; ++k) {
    SocketClient client(server->port());
    client.send(get("/endless"));
    ASSERT_TRUE(soon([&] { return asked == k + 1; })) << "who hung up is still counted, at " << k;
  }
  EXPECT_TRUE(soon([&] { return ask(get("/prompt")).starts_with("HTTP/1.1 200"); }));
  EXPECT_EQ(began, 1);
}

TEST_F(LaterTest, TheServersEndStopsWork) {
  SocketClient client(server->port());
  client.send(get("/endless"));
  ASSERT_TRUE(soon([&] { return began == 1; }));
  server->shutdown();
  EXPECT_EQ(ended, 1);
}

}  // namespace
}  // namespace ridgecast::net
