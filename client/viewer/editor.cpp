#include "client/viewer/editor.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <random>

#include "client/core/mesh/mesh_ground.h"

namespace ridgecast::viewer {
namespace {

using namespace std::chrono_literals;

constexpr std::chrono::milliseconds kSaid{8000};  // how long a sentence stays
constexpr auto kTimeout = 10s;
constexpr int kAround = 96;                             // places of an outline
constexpr double kApart = 4 * lattice::kStepsPerMetre;  // between those of a line
constexpr double kMostOfPiece = 256;                    // of them, in a piece of a line
constexpr double kReach = 1e6;                          // metres that a brush is looked for

std::string newKey() {
  std::random_device random;
  std::string key;
  for (int k = 0; k < 4; ++k) {
    char part[12];
    std::snprintf(part, sizeof part, "%08x", random());
    key += part;
  }
  return key;
}

lattice::Step along(lattice::Step from, double by) { return from + std::llround(by); }

}  // namespace

Editor::Editor(link::Client& client, const core::Url& url, ViewerState& state)
    : client_(client),
      url_(url),
      state_(state),
      editing_({[this](const wire::Edit& edit) { send(edit); }, [this](const std::string& sentence) { say(sentence); }, newKey}),
      connection_(client.connection().reconnections()) {}

Editor::~Editor() { stop_.request_stop(); }

void Editor::say(const std::string& sentence) {
  std::fprintf(stderr, "%s\n", sentence.c_str());
  state_.tell(sentence, kSaid);
}

void Editor::toggle() {
  if (state_.edit.on) return end();
  if (right_.valid()) return;
  if (client_.connection().error()) return say("Without a connection to a server, the ground cannot be edited.");
  if (client_.world().revision < 4) return say("This server is too old for edits of the ground.");
  if (url_.token.empty()) return begin();
  // An undo of nothing: refused to all, and to those without the right because of that.
  right_ = std::async(std::launch::async, [url = url_, target = "/v1/sessions/" + client_.world().session + "/edits/0",
                                           stop = stop_.get_token()] { return link::request(url, "DELETE", target, kTimeout, stop); });
}

void Editor::begin() {
  state_.edit.on = true;
  show();
}

void Editor::end() {
  editing_.rest();
  state_.edit = {};
  state_.changed = true;
  laid_.reset();
}

// What the bar shows.
void Editor::show() {
  EditMode& edit = state_.edit;
  edit.tool = editing_.tool();
  edit.material = editing_.material();
  edit.words = editing_.words();
  edit.mayUndo = editing_.mayUndo();
  state_.changed = true;
}

void Editor::click(const camera::Camera& camera, Pointer at) {
  if (!state_.edit.on) return;
  if (const auto ground = groundBelow(camera, at))
    editing_.use(*ground);
  else
    say("There is no ground.");
  show();
}

void Editor::endRoad() {
  if (!state_.edit.on) return;
  editing_.endRoad();
  show();
}

void Editor::undo() {
  if (!state_.edit.on) return;
  editing_.undo();
  show();
}

void Editor::widen(double notches) {
  if (!state_.edit.on) return;
  editing_.widen(notches);
  show();
}

void Editor::grant(const EditRequests& requests, const camera::Camera& camera) {
  if (requests.tool) editing_.choose(*requests.tool);
  if (requests.material) editing_.paint(*requests.material);
  if (requests.tool || requests.material) show();
  if (requests.notches != 0) widen(requests.notches);
  if (requests.here) click(camera, {0.5, 0.5});
  if (requests.endRoad) endRoad();
  if (requests.undo) undo();
}

void Editor::send(const wire::Edit& edit) {
  link::Connection& connection = client_.connection();
  sent_.push_back({edit.id, connection.reconnections(), connection.edit(edit)});
}

void Editor::hear() {
  const std::uint64_t now = client_.connection().reconnections();
  for (std::size_t k = 0; k < sent_.size();) {
    if (sent_[k].answer.wait_for(0s) != std::future_status::ready) {
      ++k;
      continue;
    }
    Sent sent = std::move(sent_[k]);
    sent_.erase(sent_.begin() + static_cast<std::ptrdiff_t>(k));
    const auto answer = sent.answer.get();
    // Without an answer it waits for the next connection.
    if (!answer && (sent.connection != now || client_.connection().error())) continue;
    editing_.hear(sent.id, answer ? Outcome<std::uint64_t>(answer->number) : Outcome<std::uint64_t>(answer.error()));
    if (state_.edit.on) show();
  }
  if (std::exchange(connection_, now) != now) editing_.connected();
  if (!right_.valid() || right_.wait_for(0s) != std::future_status::ready) return;
  const auto right = right_.get();
  if (right && (right->status == 401 || right->status == 403))
    say(right->text);
  else
    begin();
}

void Editor::update(const camera::Camera& camera, std::optional<Pointer> pointer, std::uint64_t sceneVersion) {
  hear();
  if (!state_.edit.on) return;
  const Pointer at = pointer.value_or(Pointer{0.5, 0.5});
  const Laid wanted{camera, at, editing_.radius(), editing_.tool(), editing_.corners().size(), sceneVersion};
  if (laid_ == wanted) return;
  laid_ = wanted;
  lay(camera, groundBelow(camera, at));
}

std::optional<lattice::Vertex> Editor::groundBelow(const camera::Camera& camera, Pointer at) const {
  const camera::Pose& pose = camera.pose;
  camera::Vec3 d = towards(camera, at.first, at.second);
  const double length = std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
  d = {d.x / length, d.y / length, d.z / length};
  const auto hit = core::cast(client_.scene(), {pose.x, pose.z, pose.y, d.x, d.y, d.z, kReach});
  if (!hit) return std::nullopt;
  const double steps = hit->distance * lattice::kStepsPerMetre;
  return lattice::Vertex{along(pose.x, d.x * steps), along(pose.z, d.z * steps),
                         static_cast<std::int32_t>(std::llround(pose.y * lattice::kStepsPerMetre + d.y * steps))};
}

// The outline of the brush, and the line of a road that ends at it, on the mesh and then in the window.
void Editor::lay(const camera::Camera& camera, const std::optional<lattice::Vertex>& at) {
  std::vector<Segment>& out = state_.edit.lines;
  out.clear();
  state_.changed = true;
  if (!at) return;
  const camera::Pose& pose = camera.pose;
  const auto place = [&](double x, double z) {  // steps from the middle
    const lattice::Point p{along(at->x, x), along(at->z, z)};
    const double y = client_.scene().height(p).value_or(at->y * lattice::kMetresPerStep);
    return camera::Vec3{(static_cast<double>(p.x - pose.x) - pose.remainderX) * lattice::kMetresPerStep, y - pose.y,
                        (static_cast<double>(p.z - pose.z) - pose.remainderZ) * lattice::kMetresPerStep};
  };
  std::optional<camera::Vec3> last;
  const auto lineTo = [&](const camera::Vec3& next) {
    if (last)
      if (const auto segment = segmentOf(camera, *last, next)) out.push_back(*segment);
    last = next;
  };
  const auto radius = static_cast<double>(editing_.radius());
  for (int k = 0; k <= kAround; ++k) {
    const double angle = 2 * std::numbers::pi * (k % kAround) / kAround;
    lineTo(place(radius * std::cos(angle), radius * std::sin(angle)));
  }
  last.reset();
  const auto& corners = editing_.corners();
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const lattice::Vertex &from = corners[k], &to = k + 1 < corners.size() ? corners[k + 1] : *at;
    const double x = static_cast<double>(from.x - at->x), z = static_cast<double>(from.z - at->z);
    const double dx = static_cast<double>(to.x - from.x), dz = static_cast<double>(to.z - from.z);
    const double pieces = std::clamp(std::ceil(std::hypot(dx, dz) / kApart), 1.0, kMostOfPiece);
    for (double p = 0; p < pieces; ++p) lineTo(place(x + dx * p / pieces, z + dz * p / pieces));
  }
  if (last) lineTo(place(0, 0));
}

}  // namespace ridgecast::viewer
