#include "server/playback/playback.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"
#include "server/recording/records.h"

namespace ridgecast::playback {

namespace {

using namespace recording;

constexpr std::chrono::milliseconds kTurn{20};
constexpr std::chrono::seconds kStay{1};                            // after going back: who asks meanwhile goes back with the last who does
constexpr std::size_t kMaxEdits = editing::Edits::kMaxWaiting / 2;  // under way

}  // namespace

struct Playback::State {
  std::vector<Parts> recordings;
  directory::Directory* directory = nullptr;
  SendAway sendAway;
  std::shared_ptr<session::Session> session;
  std::shared_ptr<const terrain::Terrain> terrain;  // without edits
  // The time that somebody wants to go back to, microseconds; 0: nobody does.
  std::shared_ptr<std::atomic<std::uint64_t>> backTo = std::make_shared<std::atomic<std::uint64_t>>(0);
  // Of this session.
  std::unique_ptr<Records> reader;
  std::optional<Record> next;
  std::shared_ptr<std::atomic<std::size_t>> openEdits;
  std::map<std::uint64_t, std::uint64_t> poses;  // the last sequence, of members
  std::jthread thread;                           // last, so that it ends first

  void run(const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any pause;
    std::chrono::steady_clock::time_point stays{};
    for (std::unique_lock lock(mutex); !stop.stop_requested(); pause.wait_for(lock, stop, kTurn, [] { return false; })) {
      const auto now = std::chrono::steady_clock::now();
      if (const std::uint64_t time = now < stays ? 0 : backTo->exchange(0)) {
        goBack(time);
        stays = now + kStay;
      }
      advance(stop);
    }
  }

  void begin(std::unique_ptr<Records> begun) {
    reader = std::move(begun);
    next = reader->next();
    openEdits = std::make_shared<std::atomic<std::size_t>>(0);
    poses.clear();
  }

  void play(const session::Session& in, const wire::Clock& clock) const {
    in.clock().play(clock, [to = backTo](std::uint64_t time) { *to = time; });
  }

  void goBack(std::uint64_t time) {
    auto begun = openRecords(recordings);
    if (!begun) return logging::warning({.session = session->name()}, begun.error().message);
    wire::Clock clock = session->clock().state();
    clock.time = time;
    const auto before = session;
    if (!directory->replace(before, terrain, [&](const session::Session& successor) { play(successor, clock); })) return;
    session = directory->find(before->name());
    begin(std::move(*begun));
    sendAway(*before);
  }

  // To the clock's time.
  void advance(const std::stop_token& stop) {
    const auto now = static_cast<std::int64_t>(session->clock().time());
    while (next && next->time <= now && *openEdits < kMaxEdits && !stop.stop_requested()) {
      std::visit([this](const auto& e) { take(e); }, next->event);
      next = reader->next();
      if (next) continue;
      for (const auto& [camera, sequence] : poses) session->presence().leave(camera);
      logging::info({.session = session->name()}, "the recording is over" + (reader->damage().empty() ? "" : ": " + reader->damage()));
    }
  }

  void take(const auto&) {}
  void take(const Joined& joined) {
    wire::Hello hello;
    hello.clientName = joined.name.substr(0, wire::kMaxNameBytes);
    hello.role = joined.role;
    if (poses.emplace(joined.camera, 0).second) session->presence().join(joined.camera, hello, nullptr, std::nullopt);
  }
  void take(const Left& left) {
    if (poses.erase(left.camera) > 0) session->presence().leave(left.camera);
  }
  void take(const Iterated& iterated) {
    const auto known = poses.find(iterated.camera);
    if (known == poses.end() || std::exchange(known->second, iterated.pose) == iterated.pose) return;
    wire::PoseMessage pose;
    pose.sequence = iterated.pose;
    pose.camera = iterated.view;
    session->presence().receive(iterated.camera, pose);
  }
  void take(const Edited& edited) {
    auto operation = operationOf(edited);
    if (!operation) return logging::warning({.session = session->name()}, "an edit of the recording: " + operation.error().message);
    ++*openEdits;
    session->edits().ask({"", edited.author, std::move(*operation)}, [open = openEdits](const Outcome<std::uint64_t>&, std::uint64_t) {
      expects((*open)-- > 0, "an edit has one answer");
    });
  }
};

Playback::Playback(std::unique_ptr<State> state) : state_(std::move(state)) {}
Playback::~Playback() = default;

Outcome<std::unique_ptr<Playback>> Playback::begin(const std::vector<Parts>& recordings, directory::Directory& directory,
                                                   std::shared_ptr<session::Session> session, double from) {
  expects(session && from >= 0, "a recording plays in a session, from its start or later");
  std::uint64_t last = 0;
  auto scanned = openRecords(recordings);
  if (!scanned) return scanned.error();
  while (const auto record = (*scanned)->next())
    if (const auto* joined = std::get_if<Joined>(&record->event)) last = std::max(last, joined->camera);
  directory.startCameraIdsAfter(last);
  auto reader = openRecords(recordings);
  if (!reader) return reader.error();
  wire::Clock clock;
  clock.end = std::max<std::uint64_t>(1, static_cast<std::uint64_t>(std::llround((*scanned)->seconds() * 1e6)));
  clock.time = static_cast<std::uint64_t>(std::min(from * 1e6, static_cast<double>(clock.end)));
  auto state = std::make_unique<State>();
  state->recordings = recordings;
  state->directory = &directory;
  state->terrain = session->terrain();
  state->session = std::move(session);
  state->begin(std::move(*reader));
  state->play(*state->session, clock);
  return std::unique_ptr<Playback>(new Playback(std::move(state)));
}

void Playback::start(SendAway sendAway) {
  expects(sendAway && !state_->thread.joinable(), "a recording is played once, to members that can be sent away");
  state_->sendAway = std::move(sendAway);
  state_->thread = std::jthread([s = state_.get()](const std::stop_token& stop) { s->run(stop); });
}

}  // namespace ridgecast::playback
