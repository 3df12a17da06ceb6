#include "server/playback/playback.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "common/edits/json.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"
#include "server/recording/reader.h"

namespace ridgecast::playback {

namespace {

using namespace recording;

constexpr std::chrono::milliseconds kTurn{20};
constexpr std::size_t kMostEdits = session::Edits::kMostWaiting / 2;  // under way

}  // namespace

struct Playback::State {
  std::unique_ptr<Reader> reader;
  std::shared_ptr<session::Session> session;
  double from = 0;
  std::optional<Record> next;
  std::shared_ptr<std::atomic<std::size_t>> openEdits = std::make_shared<std::atomic<std::size_t>>(0);
  std::map<std::uint64_t, std::uint64_t> poses;  // the last sequence, of members
  std::jthread thread;                           // last, so that it ends first

  void run(const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any pause;
    next = reader->next();
    while (next && !stop.stop_requested()) {
      const double now = from + static_cast<double>(session->presence().state().clock.time) / 1e6;
      while (next && static_cast<double>(next->time) / 1e6 <= now && *openEdits < kMostEdits && !stop.stop_requested()) {
        std::visit([this](const auto& e) { take(e); }, next->event);
        next = reader->next();
      }
      std::unique_lock lock(mutex);
      pause.wait_for(lock, stop, kTurn, [] { return false; });
    }
    if (next) return;
    for (const auto& [camera, sequence] : poses) session->presence().leave(camera);
    logging::info({.session = session->name()}, "the recording is over" + (reader->damage().empty() ? "" : ": " + reader->damage()));
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
    auto operation = edits::fromJson(edited.operation);
    if (!operation) return logging::warning({.session = session->name()}, "an edit of the recording: " + operation.error().message);
    ++*openEdits;
    session->edits().ask({"", edited.author, std::move(*operation)}, [open = openEdits](const Outcome<std::uint64_t>&) { --*open; });
  }
};

Playback::Playback(std::unique_ptr<State> state) : state_(std::move(state)) {}
Playback::~Playback() = default;

Outcome<std::unique_ptr<Playback>> Playback::begin(const std::vector<std::filesystem::path>& parts, session::Directory& directory,
                                                   std::shared_ptr<session::Session> session, double from) {
  std::uint64_t last = 0;
  auto scanned = Reader::open(parts);
  if (!scanned) return scanned.error();
  while (const auto record = (*scanned)->next())
    if (const auto* joined = std::get_if<Joined>(&record->event)) last = std::max(last, joined->camera);
  directory.startCameraIdsAfter(last);
  auto reader = Reader::open(parts);
  if (!reader) return reader.error();
  auto state = std::make_unique<State>();
  state->reader = std::move(*reader);
  state->session = std::move(session);
  state->from = from;
  State* const s = state.get();
  std::unique_ptr<Playback> out(new Playback(std::move(state)));
  s->thread = std::jthread([s](const std::stop_token& stop) { s->run(stop); });
  return out;
}

}  // namespace ridgecast::playback
