#include "client/viewer/editor.h"

#include <cstdio>

#include "client/core/hands/brush.h"

namespace ridgecast::viewer {
namespace {

using namespace std::chrono_literals;

constexpr std::chrono::milliseconds kSaid{8000};  // how long a sentence stays
constexpr auto kTimeout = 10s;
constexpr double kReach = 1e6;  // metres that a brush is looked for

}  // namespace

Editor::Editor(link::Client& client, const core::Url& url, ViewerState& state)
    : client_(client),
      url_(url),
      state_(state),
      editing_({[this](const wire::Edit& edit) { send(edit); }, [this](const std::string& sentence) { say(sentence); }}),
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
  const camera::Vec3 d = towards(camera, at.first, at.second);
  return core::touched(client_.scene(), {pose.x, pose.z, pose.y, d.x, d.y, d.z, kReach});
}

// The outline of the brush, and the line of a road that ends at it, on the mesh and then in the window.
void Editor::lay(const camera::Camera& camera, const std::optional<lattice::Vertex>& at) {
  std::vector<Segment>& out = state_.edit.lines;
  out.clear();
  state_.changed = true;
  if (!at) return;
  const camera::Pose& pose = camera.pose;
  const core::Outline outline = core::outlineOf(client_.scene(), *at, editing_.radius(), editing_.corners());
  std::optional<camera::Vec3> last;
  const auto lineTo = [&](const core::Spot& spot) {
    const camera::Vec3 next{(static_cast<double>(spot.at.x - pose.x) - pose.remainderX) * lattice::kMetresPerStep, spot.y - pose.y,
                            (static_cast<double>(spot.at.z - pose.z) - pose.remainderZ) * lattice::kMetresPerStep};
    if (last)
      if (const auto segment = segmentOf(camera, *last, next)) out.push_back(*segment);
    last = next;
  };
  for (const core::Spot& spot : outline.around) lineTo(spot);
  lineTo(outline.around.front());
  last.reset();
  for (const core::Spot& spot : outline.line) lineTo(spot);
}

}  // namespace ridgecast::viewer
