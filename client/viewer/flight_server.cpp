// Messages from and to the server.
#include <cstdio>

#include "client/viewer/flight.h"
#include "common/settings/settings.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

namespace ridgecast::viewer {
namespace {

using namespace std::chrono_literals;
constexpr auto kPoseInterval = 33ms;  // at most 30 poses a second
constexpr auto kSoon = 2ms;           // shorter work is waited for

double secondsSince(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

// What the server refines by. A pose's remainder is for drawing only.
bool sameForServer(const camera::Camera& a, const camera::Camera& b) {
  return a.pose.x == b.pose.x && a.pose.z == b.pose.z && a.pose.y == b.pose.y && a.pose.yaw == b.pose.yaw && a.pose.pitch == b.pose.pitch &&
         a.projection.width == b.projection.width && a.projection.height == b.projection.height;
}

}  // namespace

Outcome<Link> Link::open(const connection::Url& url, const wire::Settings& settings, const connection::Waiting& waiting) {
  wire::Hello hello;
  hello.clientName = "ridgecast-client view";
  hello.settings = settings;
  hello.members = true;
  auto client = replica::Client::open(url, hello, {.waiting = waiting});
  if (!client) return client.error();
  return Link{url, settings, std::move(*client)};
}

void Flight::converse() {
  if (otherWorld_) return;
  for (int k = 0; k < 4; ++k) {  // a few at a time, while they are soon done: the window goes first
    const auto update = link_.client->poll(kSoon, glfwPostEmptyEvent);
    if (!update) break;
    take(*update);
  }
  const connection::ReconnectingConnection& connection = link_.client->connection();
  otherWorld_ = connection.otherWorld();
  const auto why = otherWorld_ ? std::nullopt : connection.error();
  if (otherWorld_) {
    shown_.message =
        "The server has another world now: enter it by F2, or start the viewer anew.\nThe picture shows what had arrived. Esc quits.";
    std::fprintf(stderr, "ridgecast-client: the server has another world now\n");
    changed_ = true;
  } else if (why && !lost_) {
    shown_.message =
        "The connection to the server is lost: " + why->message + "\nThe picture shows what had arrived; trying again. Esc quits.";
    std::fprintf(stderr, "ridgecast-client: %s; trying again\n", why->message.c_str());
    changed_ = true;
  } else if (!why && lost_) {
    shown_.message.clear();
    std::fprintf(stderr, "ridgecast-client: connected again\n");
    hint("connected again");
    showSettings();
    others_.reset();
    othersSeen_ = 0;
  }
  lost_ = why.has_value();
  lookForMembers();
  if (connection->granted() != shownSettings_) showSettings();
  sendPose();
}

void Flight::lookForMembers() {
  auto others = link_.client->connection()->others(othersSeen_);
  if (!others) return;
  othersSeen_ = others->version();
  others_ = std::move(*others);
  changed_ = true;
}

void Flight::take(const replica::Update& update) {
  const wire::Iteration& iteration = update.iteration;
  if (update.wrong) std::fprintf(stderr, "warning: %s; asking for leaves again\n", update.wrong->message.c_str());
  ages_.update(scene_.leaves(), std::chrono::duration<double>(Clock::now().time_since_epoch()).count());
  ++sceneVersion_;
  ++iterationsCounted_;
  const wire::Figures& f = iteration.figures;
  const std::array<double, 5> stages = {f.selectMs, f.generateMs, f.refineMs, f.triangulateMs, f.encodeMs};
  for (std::size_t k = 0; k < stages.size(); ++k) shown_.history.stages[k].add(stages[k]);
  building_.iterated(std::uint64_t{f.inserted} + f.removed, iteration.settled);
  shown_.hashOk = !update.wrong;
  shown_.settled = iteration.settled && !update.wrong;
  shown_.iteration = iteration.number;
  shown_.triangles = scene_.triangles();
  shown_.leaves = scene_.leaves().size();
  shown_.effectiveThreshold = f.effectiveThreshold;
  if (const auto pose = sent_.find(iteration.poseSequence); pose != sent_.end()) {
    shown_.latencyMs = secondsSince(pose->second) * 1e3;
    shown_.history.latency.add(shown_.latencyMs);
    sent_.erase(sent_.begin(), std::next(pose));
  }
  if (iteration.candidates && shown_.candidates) {
    candidates_ = std::make_shared<const std::vector<wire::Candidate>>(*iteration.candidates);
    shown_.candidateCount = candidates_->size();
    shown_.candidateUnit = candidateUnit();
    restructure();
  }
  if (shown_.borders == Borders::kAge) restructure();
  changed_ = true;
}

// Candidates are a setting: the server sends them while they are requested.
void Flight::wantCandidates(bool want) {
  if (want && !shown_.live) return hint("this server sends no candidates");
  shown_.candidates = want;
  link_.settings.candidates = want ? wire::kMaxCandidates : 0;
  link_.client->connection().change(link_.settings);
  if (!want) {
    candidates_.reset();
    shown_.candidateCount = 0;
  }
  hint(want ? "candidates for vertices" : "no candidates");
  restructure();
}

double Flight::candidateUnit() const {
  return link_.client->connection()->granted().metric == wire::Metric::kPixels ? std::max(shown_.effectiveThreshold, 1e-3) : 1;
}

void Flight::sendPose() {
  const camera::Camera camera = frozen_ ? *frozen_ : camera::Camera{controls_.pose(), projection()};
  const bool same = sentCamera_ && sameForServer(*sentCamera_, camera);
  if (same || Clock::now() - sentAt_ < kPoseInterval) return;
  sentCamera_ = camera;
  sentAt_ = Clock::now();
  sent_[link_.client->send(camera)] = sentAt_;
  if (sent_.size() > 256) sent_.erase(sent_.begin());
}

void Flight::lookForWorld() {
  if (!nextWorld_) return;
  auto next = nextWorld_->take();
  if (!next) {
    // Shown in the panel if it is still open; short waits are not shown.
    if (nextWorld_->seconds() < 1) return;
    const std::string waits = nextWorld_->describe() + "; Esc gives up";
    if (waits != shown_.problem) hint(shown_.problem = waits);
    return;
  }
  nextWorld_.reset();
  changed_ = true;
  if (*next) {
    arrived_ = std::move(**next);
    return;
  }
  shown_.problem = next->error().message;
  std::fprintf(stderr, "ridgecast-client: %s\n", shown_.problem.c_str());
  if (!shown_.panel) hint(shown_.problem);
}

void Flight::giveUpWorld() {
  nextWorld_.reset();
  hint("stayed here");
  shown_.problem.clear();
}

void Flight::showSettings() {
  const wire::Settings granted = link_.client->connection()->granted();
  shownSettings_ = granted;
  shown_.live = link_.client->world().revision >= 2;
  changed_ = true;
  Choices& c = shown_.choices;
  c.metric = static_cast<int>(granted.metric);
  c.threshold = static_cast<float>(granted.threshold);
  c.triangles = static_cast<int>(granted.triangleBudget / 1000);
  c.kilobytes = static_cast<int>(granted.bytesPerSecond / 1000);
  char text[120];
  std::snprintf(text, sizeof text, "%s %.4g, %u triangles%s", settings::traits(granted.metric).name.data(), granted.threshold,
                granted.triangleBudget,
                granted.bytesPerSecond ? (", " + std::to_string(granted.bytesPerSecond / 1000) + " kB/s").c_str() : "");
  shown_.granted = text;
}

void Flight::changeSettings() {
  const Choices& c = shown_.choices;
  wire::Settings& asked = link_.settings;
  const auto metric = static_cast<wire::Metric>(c.metric);
  // Thresholds of two metrics have nothing to do with each other.
  asked.threshold = metric == link_.client->connection()->granted().metric ? static_cast<double>(c.threshold) : 0;
  asked.metric = metric;
  asked.triangleBudget = static_cast<std::uint32_t>(c.triangles) * 1000;
  asked.bytesPerSecond = static_cast<std::uint64_t>(c.kilobytes) * 1000;
  link_.client->connection().change(asked);
}

}  // namespace ridgecast::viewer
