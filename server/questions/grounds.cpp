#include "server/questions/grounds.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <utility>

#include "common/codec/codec.h"
#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/box/box_mesh.h"

namespace ridgecast::questions {

namespace {

constexpr double kMaxError = 100;    // metres, of a question
constexpr double kCoarser = 3;       // times what was reached: tried where that does not fit
constexpr double kUnknown = 8;       // times the error: the same where nothing was reached
constexpr std::size_t kAtATime = 4;  // leaves between two looks at the clock: about ten milliseconds

// Keeps the triangles whose bounding box touches the circle.
void trim(mesh::LeafMesh& leaf, lattice::Point at, double radius) {
  const lattice::Step cornerX = leaf.address.x() - at.x, cornerZ = leaf.address.z() - at.z;
  std::erase_if(leaf.triangles, [&](const mesh::Triangle& t) {
    lattice::Step lowX = lattice::kMaxPosition, highX = -lowX, lowZ = lowX, highZ = -lowX;
    for (const std::uint32_t v : t) {
      lowX = std::min(lowX, cornerX + leaf.vertices[v].x), highX = std::max(highX, cornerX + leaf.vertices[v].x);
      lowZ = std::min(lowZ, cornerZ + leaf.vertices[v].z), highZ = std::max(highZ, cornerZ + leaf.vertices[v].z);
    }
    const auto dx = static_cast<double>(std::max({lowX, -highX, lattice::Step{0}}));
    const auto dz = static_cast<double>(std::max({lowZ, -highZ, lattice::Step{0}}));
    return dx * dx + dz * dz > radius * radius;
  });
  mesh::canonicalize(leaf);
}

}  // namespace

struct Grounds::Work {
  wire::AskGround ask;
  editing::Ground on;
  box::Watch watch;
  double error = 0;                       // metres: more than asked for in trials of what fits
  std::unique_ptr<box::Meshing> meshing;  // then there are leaves
  std::vector<mesh::LeafMesh> leaves;
  std::size_t encoded = 0;  // of the leaves
  wire::Ground ground;      // its leaves stand beside `leaves`

  bool isTrial() const { return error > ask.error; }
};

Grounds::Grounds(std::function<editing::Ground()> ground, std::uint32_t triangleBudget, std::shared_ptr<session::SlotQueue> queue,
                 std::shared_ptr<conversation::Sender> sender, std::chrono::seconds timeout, std::chrono::milliseconds turn)
    : ground_(std::move(ground)),
      triangleBudget_(triangleBudget),
      queue_(std::move(queue)),
      sender_(std::move(sender)),
      timeout_(timeout),
      turn_(turn) {
  expects(ground_ && queue_ && sender_ && turn_.count() > 0, "who asks for grounds waits in a queue, works in turns and is answered");
}

Grounds::~Grounds() = default;

bool Grounds::ask(const wire::AskGround& ask) {
  {
    const std::lock_guard lock(mutex_);
    if (*open_ >= wire::kMaxGrounds) return false;
    ++*open_;
    auto work = std::make_unique<Work>();
    work->ask = ask;
    work->on = ground_();
    work->error = ask.error;
    work->watch = {stop_.get_token(), Clock::now() + timeout_, static_cast<double>(timeout_.count())};
    pending_.push_back(std::move(work));
    if (std::exchange(runs_, true)) return true;
  }
  queue_->enter(weak_from_this());
  return true;
}

void Grounds::close() { stop_.request_stop(); }

void Grounds::begin(session::SlotQueue::Slot slot) {
  queue_->pool().post([self = shared_from_this(), slot = std::move(slot)]() mutable { self->run(std::move(slot)); });
}

void Grounds::run(session::SlotQueue::Slot slot) {
  if (stop_.stop_requested()) return;  // nobody waits any more
  Work* work = nullptr;
  {
    const std::lock_guard lock(mutex_);
    expects(!pending_.empty(), "a turn has its question");
    work = pending_.front().get();
  }
  try {
    auto answer = turn(*work);
    if (!answer) return begin(std::move(slot));
    answer->edit = work->on.edit;
    if (!stop_.stop_requested()) sender_->send(std::move(*answer), conversation::ticketOf(open_));
  } catch (const std::exception& e) {
    return sender_->fail(conversation::failureOf(e));
  }
  std::unique_ptr<Work> done;  // destroyed before the slot is released, and without the lock
  {
    const std::lock_guard lock(mutex_);
    expects(!pending_.empty() && pending_.front().get() == work, "what is answered waits first");
    done = std::move(pending_.front());
    pending_.pop_front();
    runs_ = !pending_.empty();
    if (!runs_) return;
  }
  queue_->enter(weak_from_this());  // behind the others
}

std::optional<wire::Ground> Grounds::turn(Work& work) const {
  const auto until = Clock::now() + turn_;
  if (work.watch.over() && work.isTrial()) return unfit(work, "");
  if (work.watch.over())
    return refusal(work, "This ground was not ready within " + text::rounded(work.watch.seconds, 3) +
                             " s, because the server is busy; ask again later, or for a larger error or a smaller radius.");
  if (work.leaves.empty()) return mesh(work, until);
  auto& leaves = work.ground.leaves;
  if (!eachLeaf(work, work.encoded, until, [&](std::size_t k) {
        mesh::LeafMesh& leaf = work.leaves[k];
        trim(leaf, work.ask.at, work.ask.radius * lattice::kStepsPerMetre);
        if (leaf.triangles.empty()) return;
        leaves[k] = {leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
                     codec::encodeLeaf(leaf), static_cast<float>(work.ground.error)};
      }))
    return {};
  std::erase_if(leaves, [](const wire::LeafWhole& leaf) { return leaf.triangles == 0; });
  work.ground.id = work.ask.id;
  return std::move(work.ground);
}

// Empty: it goes on, with the leaves once they are there.
std::optional<wire::Ground> Grounds::mesh(Work& work, Clock::time_point until) const {
  if (!work.meshing) {
    const auto reach = static_cast<lattice::Step>(std::ceil(work.ask.radius * lattice::kStepsPerMetre)) + 1;
    const auto within = [](lattice::Step v) { return std::clamp(v, -lattice::kMaxPosition, lattice::kMaxPosition); };
    const lattice::Point at = work.ask.at;
    const box::Box box{{within(at.x - reach), within(at.z - reach)}, {within(at.x + reach), within(at.z + reach)}, work.error};
    work.meshing = std::make_unique<box::Meshing>(*work.on.terrain, box, triangleBudget_, queue_->pool(), work.watch);
  }
  auto made = work.meshing->work(until);
  if (!made) return {};
  work.meshing.reset();
  if (*made && work.isTrial()) return unfit(work, "an error of " + text::rounded(work.error, 3) + " m fits, or ");
  if (*made) {
    work.leaves = std::move((*made)->leaves);
    expects(!work.leaves.empty(), "a mesh of a square has leaves");
    work.ground.leaves.resize(work.leaves.size());
    work.ground.error = (*made)->error;
  } else if (made->error().kind == box::Problem::Kind::kTooMuch) {
    return coarser(work, made->error().error);
  }
  return {};  // out of time: the next turn says so
}

// The error does not fit: looks for one that does.
std::optional<wire::Ground> Grounds::coarser(Work& work, double reached) const {
  if (work.error >= kMaxError) return unfit(work, "");
  const double before =
      std::exchange(work.error, std::min(kMaxError, std::max(kCoarser * reached, (reached > 0 ? 1.5 : kUnknown) * work.error)));
  expects(work.error > before, "each trial is coarser than the one before");
  return {};
}

bool Grounds::eachLeaf(const Work& work, std::size_t& done, Clock::time_point until, const std::function<void(std::size_t)>& body) const {
  while (done < work.leaves.size()) {
    if (Clock::now() >= until) return false;
    const std::size_t count = std::min(kAtATime, work.leaves.size() - done);
    queue_->pool().forEach(count, 1, [&](std::size_t k) { body(done + k); });
    done += count;
  }
  return true;
}

wire::Ground Grounds::unfit(const Work& work, const std::string& fits) const {
  return refusal(work, "No mesh of at most " + std::to_string(triangleBudget_) + " triangles, the camera's budget, keeps an error of " +
                           text::rounded(work.ask.error, 3) + " m over a circle of " + text::rounded(work.ask.radius, 6) + " m here; " +
                           fits + "ask for a smaller radius.");
}

wire::Ground Grounds::refusal(const Work& work, std::string sentence) {
  wire::Ground out;
  out.id = work.ask.id;
  out.refusal = std::move(sentence);
  return out;
}

}  // namespace ridgecast::questions
