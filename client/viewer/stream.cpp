#include "client/viewer/stream.h"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <utility>

#include "client/viewer/people.h"
#include "common/settings/settings.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

namespace ridgecast::viewer {
namespace {

using namespace std::chrono_literals;
constexpr auto kPoseInterval = 33ms;  // at most 30 poses a second
constexpr auto kSoon = 2ms;           // shorter work is waited for
constexpr auto kBriefly = 500ms;      // shorter losses are not shown

using Clock = std::chrono::steady_clock;

}  // namespace

Outcome<Link> Link::open(const core::Url& url, const wire::Settings& settings, const std::string& name, const link::Waiting& waiting) {
  wire::Hello hello;
  hello.clientName = name;
  hello.settings = settings;
  hello.members = hello.clock = true;
  hello.near = 24;
  auto client = link::Client::open(url, hello, {.waiting = waiting});
  if (!client) return client.error();
  return Link{url, settings, std::move(*client)};
}

Arrival::Arrival(const core::Url& url, const wire::Settings& settings, const std::string& name) : where_(url.host + ":" + url.port) {
  link::Waiting waiting;
  waiting.preparing = [this] { prepares_ = true; };
  waiting.stop = stop_.get_token();
  link_ = std::async(std::launch::async, [url, settings, name, waiting] { return Link::open(url, settings, name, waiting); });
}

Arrival::~Arrival() { stop_.request_stop(); }

std::optional<Outcome<Link>> Arrival::take() {
  if (!link_.valid() || link_.wait_for(0ms) != std::future_status::ready) return std::nullopt;
  return link_.get();
}

std::string Arrival::describe() const {
  return "waiting for " + where_ + (prepares_ ? " to prepare the terrain, " : " to answer, ") +
         std::to_string(static_cast<int>(seconds())) + " s";
}

Stream::Stream(Link link, ViewerState& state) : link_(std::move(link)), state_(state) {
  const wire::World& world = client().world();
  state.statistics.world =
      world.terrainName + ", seed " + std::to_string(world.seed) + ", session " + world.session + ", from " + world.serverName;
  std::snprintf(state.panel.terrain.data(), state.panel.terrain.size(), "%s", world.terrainName.c_str());
  state.panel.offer.here = world.session;
  std::snprintf(state.panel.seed.data(), state.panel.seed.size(), "%u", world.seed);
  showSettings();
}

void Stream::exchange(const camera::Camera& camera) {
  if (otherWorld_) return;
  for (int k = 0; k < 4; ++k) {  // a few at a time, while they are soon done: the window goes first
    const auto update = client().poll(kSoon, glfwPostEmptyEvent);
    if (!update) break;
    accept(*update);
  }
  watchConnection();
  if (auto others = client().connection().others(others_ ? others_->version() : 0)) {
    others_ = std::move(*others);
    state_.changed = true;
  }
  followClock();
  showWorlds();
  if (client().connection().granted() != shownSettings_) showSettings();
  state_.statistics.bytes = client().connection().bytesReceived();
  poses_.send(client(), camera);
}

void Stream::watchConnection() {
  const link::Connection& connection = client().connection();
  otherWorld_ = connection.otherWorld();
  const bool isAnother = std::exchange(reconnections_, connection.reconnections()) != connection.reconnections();
  const auto why = otherWorld_ ? std::nullopt : connection.error();
  if (otherWorld_) {
    state_.message =
        "The server has another world now; entering it. If that fails, J enters one by its name.\nThe picture shows what had arrived. "
        "Ctrl+Q quits.";
    std::fprintf(stderr, "ridgecast-client: the server has another world now; entering it\n");
    state_.changed = true;
    if (!next_) next_.emplace(link_.url, link_.settings, ownName(state_.panel.name.data()));
  } else if (why) {
    if (!lost_) {
      std::fprintf(stderr, "ridgecast-client: %s; trying again\n", why->message.c_str());
      lostAt_ = Clock::now();
      loss_ = "The connection to the server is lost: " + why->message + "\nThe picture shows what had arrived; trying again. Ctrl+Q quits.";
    }
    // A recording that begins again is back at once.
    if (state_.message != loss_ && Clock::now() - lostAt_ > kBriefly) {
      state_.message = loss_;
      state_.changed = true;
    }
  } else if (isAnother) {
    std::fprintf(stderr, "ridgecast-client: connected again\n");
    if (!state_.message.empty()) state_.tell("connected again");
    state_.message.clear();
    showSettings();
    others_.reset();
    clockSeen_ = step_ = 0;
  }
  lost_ = why.has_value();
}

// No step waits for more than the answer to it; what the server says about the clock is shown.
void Stream::followClock() {
  link::Connection& connection = client().connection();
  const bool isNew = connection.waitForClock(clockSeen_, 0ms);
  if (!isNew && (!state_.clock.on || !state_.clock.runs)) return;
  const core::SessionClock clock = connection.clock();
  showClock(clock);
  if (!isNew) return;
  clockSeen_ = clock.version();
  if (clock.said().step > step_) connection.stepDone({clock.said().step});
  step_ = clock.said().step;
  if (clock.notice().empty() || clock.notice() == notice_) return;
  notice_ = clock.notice();
  std::fprintf(stderr, "%s\n", notice_.c_str());
  state_.tell(notice_, kNoticeTime);
}

void Stream::showClock(const core::SessionClock& clock) {
  core::ClockBar& bar = state_.clock;
  const std::string before = core::clockText(bar.time) + bar.driver;
  const core::Roster nobody;
  bar.hear(clock, client().world(), (others_ ? *others_ : nobody).others(), Clock::now());
  if (clock.version() != clockSeen_ || (bar.on && before != core::clockText(bar.time) + bar.driver)) state_.changed = true;
}

void Stream::setClock(const wire::SetClock& set) {
  if (const std::string why = lost_ ? core::ClockBar().refusal(set) : state_.clock.refusal(set); !why.empty()) return state_.tell(why);
  link::Connection& connection = client().connection();
  connection.setClock(set);
  connection.setClock({.own = false});
  state_.clock.goOn(set);
}

void Stream::accept(const link::Update& update) {
  const wire::Iteration& iteration = update.iteration;
  if (update.wrong) std::fprintf(stderr, "warning: %s; requesting leaves again\n", update.wrong->message.c_str());
  ages_.update(client().scene().leaves(), nowInSeconds());
  ++sceneVersion_;
  Statistics& s = state_.statistics;
  const wire::IterationStats& f = iteration.figures;
  const std::array<double, 5> stages = {f.selectMs, f.generateMs, f.refineMs, f.triangulateMs, f.encodeMs};
  for (std::size_t k = 0; k < stages.size(); ++k) s.plots.stages[k].add(stages[k]);
  s.building.iterated(std::uint64_t{f.inserted} + f.removed, iteration.settled);
  s.hashOk = !update.wrong;
  s.settled = iteration.settled && !update.wrong;
  s.iteration = iteration.number;
  s.triangles = client().scene().triangles();
  s.leaves = client().scene().index().size();
  s.effectiveThreshold = f.effectiveThreshold;
  if (const auto latency = poses_.answered(iteration.poseSequence)) s.plots.latency.add(s.latencyMs = *latency);
  if (iteration.candidates && state_.lines.candidates) {
    candidates_ = std::make_shared<const std::vector<wire::Candidate>>(*iteration.candidates);
    s.candidates = candidates_->size();
    s.candidateUnit = client().connection().granted().metric == wire::Metric::kPixels ? std::max(s.effectiveThreshold, 1e-3) : 1;
  }
  state_.changed = true;
}

// Candidates are a setting: the server sends them while they are requested.
void Stream::requestCandidates(bool want) {
  if (want && !state_.panel.live) return state_.tell("this server sends no candidates");
  state_.lines.candidates = want;
  link_.settings.candidates = want ? wire::kMaxCandidates : 0;
  client().connection().change(link_.settings);
  if (!want) {
    candidates_.reset();
    state_.statistics.candidates = 0;
  }
  state_.tell(want ? "candidates for vertices" : "no candidates");
}

void Stream::measure(double seconds) {
  Statistics& s = state_.statistics;
  s.iterationsPerSecond = static_cast<double>(sceneVersion_ - std::exchange(versionCounted_, sceneVersion_)) / seconds;
  s.plots.bytes.add(static_cast<double>(s.bytes - std::exchange(bytesCounted_, s.bytes)) / seconds / 1e3);
  s.plots.triangles.add(static_cast<double>(s.triangles) / 1e3);
}

void SentPoses::send(link::Client& client, const camera::Camera& camera) {
  camera::Camera refinedBy = camera;  // a pose's remainder is for drawing only
  refinedBy.pose.remainderX = refinedBy.pose.remainderZ = 0;
  if (camera_ == refinedBy || Clock::now() - at_ < kPoseInterval) return;
  camera_ = refinedBy;
  at_ = Clock::now();
  sent_[client.send(camera)] = at_;
  if (sent_.size() > 256) sent_.erase(sent_.begin());
}

std::optional<double> SentPoses::answered(std::uint64_t sequence) {
  const auto pose = sent_.find(sequence);
  if (pose == sent_.end()) return std::nullopt;
  const double since = secondsSince(pose->second) * 1e3;
  sent_.erase(sent_.begin(), std::next(pose));
  return since;
}

std::optional<Link> Stream::enteredWorld() {
  if (!next_) return std::nullopt;
  auto next = next_->take();
  if (!next) {
    // Shown in the panel if it is still open; short waits are not shown.
    if (next_->seconds() < 1) return std::nullopt;
    const std::string waits = next_->describe() + "; Esc gives up";
    if (waits != state_.panel.problem) state_.tell(state_.panel.problem = waits);
    return std::nullopt;
  }
  next_.reset();
  state_.changed = true;
  if (*next) return std::move(**next);
  state_.panel.problem = next->error().message;
  std::fprintf(stderr, "ridgecast-client: %s\n", state_.panel.problem.c_str());
  if (!state_.panel.open()) state_.tell(state_.panel.problem);
  return std::nullopt;
}

void Stream::giveUpWorld() {
  next_.reset();
  state_.tell("stayed here");
  state_.panel.problem.clear();
}

void Stream::showSettings() {
  const wire::Settings& granted = shownSettings_ = client().connection().granted();
  state_.changed = true;
  Panel& c = state_.panel;
  c.live = client().world().revision >= 2;
  c.metric = static_cast<int>(granted.metric);
  c.threshold = static_cast<float>(granted.threshold);
  c.triangles = static_cast<int>(granted.triangleBudget / 1000);
  c.kilobytes = static_cast<int>(granted.bytesPerSecond / 1000);
  char text[120];
  std::snprintf(text, sizeof text, "%s %.4g, %u triangles%s", settings::traits(granted.metric).name.data(), granted.threshold,
                granted.triangleBudget,
                granted.bytesPerSecond ? (", " + std::to_string(granted.bytesPerSecond / 1000) + " kB/s").c_str() : "");
  c.granted = text;
}

void Stream::requestSettings() {
  const Panel& c = state_.panel;
  wire::Settings& requested = link_.settings;
  const auto metric = static_cast<wire::Metric>(c.metric);
  // Thresholds of two metrics have nothing to do with each other.
  requested.threshold = metric == client().connection().granted().metric ? static_cast<double>(c.threshold) : 0;
  requested.metric = metric;
  requested.triangleBudget = static_cast<std::uint32_t>(c.triangles) * 1000;
  requested.bytesPerSecond = static_cast<std::uint64_t>(c.kilobytes) * 1000;
  client().connection().change(requested);
}

void Stream::requestWorlds() {
  if (question_) return;
  state_.panel.offer.problem = "asking the server ...";
  question_.emplace(link_.url);
}

void Stream::showWorlds() {
  auto answer = question_ ? question_->take() : std::nullopt;
  if (!answer) return;
  question_.reset();
  state_.panel.offer.problem = *answer ? "" : answer->error().message;
  state_.panel.offer.worlds = *answer ? std::move(**answer) : Worlds();
  state_.changed = true;
}

void Stream::enterSession(const std::string& name) {
  if (next_) return;
  core::Url url = link_.url;
  url.session = name;
  url.world.clear();
  state_.panel.problem = "entering ...";
  next_.emplace(url, link_.settings, ownName(state_.panel.name.data()));
}

void Stream::enterWorld() {
  if (next_) return;
  const std::string terrain = state_.panel.terrain.data(), seed = state_.panel.seed.data();
  std::uint32_t number = 0;
  const auto parsed = std::from_chars(seed.data(), seed.data() + seed.size(), number);
  const bool plain = !terrain.empty() && std::all_of(terrain.begin(), terrain.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '.' || c == '_' || c == '-';
  });
  state_.changed = true;
  if (!plain || terrain.size() > 40)
    return void(state_.panel.problem =
                    "'" + terrain.substr(0, 60) + "' is not a terrain's name: at most 40 letters, digits, . _ -, such as canyon");
  if (parsed.ec != std::errc() || parsed.ptr != seed.data() + seed.size())
    return void(state_.panel.problem = "'" + seed + "' is not a seed: give a whole number from 0 to 4294967295");
  core::Url url = link_.url;
  url.session = terrain + "-" + std::to_string(number);
  url.world = "terrain=" + terrain + "&seed=" + std::to_string(number);
  state_.panel.problem = "entering ...";
  next_.emplace(url, link_.settings, ownName(state_.panel.name.data()));
}

}  // namespace ridgecast::viewer
