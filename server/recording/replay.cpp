#include "server/recording/replay.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <map>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/text/text.h"
#include "server/pipeline/pipeline.h"

namespace ridgecast::recording {

namespace {

using Terrain = std::shared_ptr<const terrain::Terrain>;

constexpr std::uint32_t kMaxBudget = 50'000'000;  // that a server's operator can allow
constexpr std::size_t kGroundsKept = 1024;        // behind the oldest that a camera has: one may join on an older ground

// What one iteration is given.
struct Job {
  Iterated given;
  Terrain ground;              // other than before
  std::uint64_t position = 0;  // of the record
  double seconds = 0;
  bool isJudged = false;
};

// Shared by the cameras.
struct Progress {
  std::mutex mutex;
  std::condition_variable changed;
  std::size_t queued = 0;
  std::uint64_t iterations = 0, before = 0;
  std::uint64_t position = 0;  // of `first`
  std::optional<Difference> first;
  std::string error;
  bool isOver() const { return first || !error.empty(); }
};

// One camera's mesh; its jobs are done one after another by tasks of its pool.
class Repeated : public std::enable_shared_from_this<Repeated> {
 public:
  Repeated(const Joined& joined, Terrain ground, scheduling::Executor& executor, std::shared_ptr<Progress> progress)
      : pool_(executor.makePool()),
        progress_(std::move(progress)),
        camera_(joined.camera),
        granted_(joined.granted),
        ground_(std::move(ground)) {}

  void add(Job job) {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(std::move(job));
    if (!std::exchange(scheduled_, true)) pool_->post([self = shared_from_this()] { self->run(); });
  }

 private:
  void run() {
    Job job;
    {
      const std::lock_guard lock(mutex_);
      job = std::move(jobs_.front());
      jobs_.pop_front();
    }
    std::string error;
    std::uint64_t hash = 0;
    try {
      if (!differs_) hash = repeat(job);
    } catch (const std::exception& e) {
      error = std::string("A camera's mesh cannot be repeated: ") + e.what();
    }
    tell(job, hash, std::move(error));
    const std::lock_guard lock(mutex_);
    scheduled_ = !jobs_.empty();
    if (scheduled_) pool_->post([self = shared_from_this()] { self->run(); });
  }

  // As CameraSession gives its mesh an iteration.
  std::uint64_t repeat(const Job& job) {
    if (!mesh_) mesh_ = std::make_unique<pipeline::Pipeline>(std::exchange(ground_, nullptr), granted_, pool_);
    if (job.given.granted) mesh_->change(*job.given.granted);
    mesh_->setInsertionLimit(job.given.insertions);
    if (job.ground) mesh_->setGround(job.ground, job.given.changed);
    mesh_->iterate(job.given.view);
    ++iteration_;
    return hashOf(mesh_->leaves());
  }

  void tell(const Job& job, std::uint64_t hash, std::string error) {
    Progress& p = *progress_;
    const std::lock_guard lock(p.mutex);
    const bool isMade = !differs_ && error.empty();
    if (isMade) ++(job.isJudged ? p.iterations : p.before);
    if (!error.empty() && p.error.empty()) p.error = std::move(error);
    if (job.given.hash >> 32 == 0) hash &= 0xffffffffu;  // its low half alone was kept
    if (isMade && job.isJudged && hash != job.given.hash) {
      differs_ = true;  // what follows would differ, too
      if (!p.first || job.position < p.position) {
        p.first = Difference{camera_, iteration_, job.seconds, job.given.hash, hash};
        p.position = job.position;
      }
    }
    --p.queued;
    p.changed.notify_all();
  }

  const std::shared_ptr<scheduling::Pool> pool_;
  const std::shared_ptr<Progress> progress_;
  const std::uint64_t camera_;
  const settings::Settings granted_;
  Terrain ground_;  // on which it begins
  std::mutex mutex_;
  std::deque<Job> jobs_;
  bool scheduled_ = false;
  // Of the running task.
  std::unique_ptr<pipeline::Pipeline> mesh_;
  std::uint64_t iteration_ = 0;
  bool differs_ = false;
};

class Replaying {
 public:
  Replaying(Terrain terrain, scheduling::Executor& executor, const Span& span, std::set<std::uint64_t> skipped)
      : terrain_(terrain), executor_(executor), span_(span), skipped_(std::move(skipped)), history_(terrain) {
    grounds_.push_back(std::move(terrain));
  }

  Outcome<Summary> run(Records& reader) {
    while (auto record = reader.next()) {
      const double seconds = static_cast<double>(record->time) / 1e6;
      if (seconds > span_.until) break;
      ++position_;
      const Outcome<void> taken = std::visit([&](const auto& e) { return take(e, seconds); }, record->event);
      if (!taken) fail("At " + text::rounded(seconds, 6) + " s: " + taken.error().message);
      summary_.seconds = seconds;
      std::unique_lock lock(progress_->mutex);
      progress_->changed.wait(lock, [&] { return progress_->queued < kMaxQueued; });
      if (progress_->isOver()) break;
    }
    std::unique_lock lock(progress_->mutex);
    progress_->changed.wait(lock, [&] { return progress_->queued == 0; });
    if (!progress_->error.empty()) return Error{progress_->error};
    summary_.iterations = progress_->iterations;
    summary_.before = progress_->before;
    summary_.first = progress_->first;
    return summary_;
  }

 private:
  struct Live {
    std::shared_ptr<Repeated> mesh;  // null: it is not repeated
    bool isKnown = false;            // its beginning is there
    std::uint64_t edit = 0;
  };

  void fail(std::string error) {
    const std::lock_guard lock(progress_->mutex);
    if (progress_->error.empty()) progress_->error = std::move(error);
  }

  Outcome<void> take(const World&, double) { return {}; }
  Outcome<void> take(const EditsBefore&, double) { return {}; }
  Outcome<void> take(const Clocked&, double) { return {}; }
  Outcome<void> take(const Asked&, double) { return ++summary_.questions, Outcome<void>(); }
  Outcome<void> take(const Left& left, double) { return live_.erase(left.camera), Outcome<void>(); }

  Outcome<void> take(const Edited& edited, double) {
    if (edited.number != history_.last() + 1) return Error{"Edit " + std::to_string(history_.last() + 1) + " is missing."};
    auto operation = operationOf(edited);
    if (!operation) return operation.error();
    const auto added = history_.add(std::move(*operation));
    if (!added) return added.error();
    ++summary_.edits;
    grounds_.push_back(std::make_shared<edits::EditedTerrain>(terrain_, history_.layer()));
    std::uint64_t oldest = history_.last();
    for (const auto& [camera, live] : live_)
      if (live.isKnown) oldest = std::min(oldest, live.edit);
    for (; grounds_.size() > kGroundsKept && firstGround_ < oldest; ++firstGround_) grounds_.pop_front();
    return {};
  }

  // The ground of an edit. Error: there is none.
  Outcome<Terrain> groundOf(std::uint64_t edit) const {
    if (edit < firstGround_ || edit > history_.last())
      return Error{"The ground of edit " + std::to_string(edit) + " is not in the recording."};
    return grounds_[edit - firstGround_];
  }

  Outcome<void> check(const settings::Settings& granted) const {
    settings::Settings fits = pipeline::grant(granted, {settings::kDefaultBudget, kMaxBudget});
    if (!terrain_->colours()) fits.colourError = 0;
    if (fits == granted) return {};
    return Error{"A camera has settings that no server grants."};
  }

  Outcome<void> take(const Joined& joined, double) {
    Live live{nullptr, !joined.again, joined.edit};
    const bool isSkipped = skipped_.contains(lives_++);
    if (live.isKnown) {
      auto ground = groundOf(joined.edit);
      if (!ground) return ground.error();
      if (auto fits = check(joined.granted); !fits) return fits.error();
      if (!isSkipped) {
        ++summary_.cameras;
        live.mesh = std::make_shared<Repeated>(joined, std::move(*ground), executor_, progress_);
      }
    }
    live_[joined.camera] = std::move(live);
    return {};
  }

  Outcome<void> take(const Iterated& given, double seconds) {
    Live& live = live_[given.camera];
    const bool isJudged = seconds >= span_.from;
    if (!live.mesh) {
      if (isJudged) ++summary_.unknown;
      return {};
    }
    Job job{given, nullptr, position_, seconds, isJudged};
    if (given.edit != live.edit) {
      auto ground = groundOf(given.edit);
      if (!ground || given.edit < live.edit) return Error{"A camera's ground goes back, or is not in the recording."};
      job.ground = std::move(*ground);
    }
    if (given.granted)
      if (auto fits = check(*given.granted); !fits) return fits.error();
    live.edit = given.edit;
    {
      const std::lock_guard lock(progress_->mutex);
      ++progress_->queued;
    }
    live.mesh->add(std::move(job));
    return {};
  }

  const Terrain terrain_;
  scheduling::Executor& executor_;
  const Span span_;
  const std::set<std::uint64_t> skipped_;  // of lives, in the order of their beginning: those that end before span_.from
  const std::shared_ptr<Progress> progress_ = std::make_shared<Progress>();
  edits::History history_;
  std::deque<Terrain> grounds_;  // from edit firstGround_ on
  std::uint64_t firstGround_ = 0;
  std::map<std::uint64_t, Live> live_;
  std::uint64_t lives_ = 0, position_ = 0;
  Summary summary_;
};

// The lives that end before a time, by the number of their beginning.
std::set<std::uint64_t> endedBefore(Records& reader, double seconds) {
  std::set<std::uint64_t> out;
  std::map<std::uint64_t, std::uint64_t> live;
  std::uint64_t lives = 0;
  while (const auto record = reader.next()) {
    if (static_cast<double>(record->time) >= seconds * 1e6) break;
    if (const auto* joined = std::get_if<Joined>(&record->event)) live[joined->camera] = lives++;
    if (const auto* left = std::get_if<Left>(&record->event))
      if (const auto ended = live.extract(left->camera)) out.insert(ended.mapped());
  }
  return out;
}

}  // namespace

Outcome<Summary> replay(const std::vector<Parts>& recordings, std::shared_ptr<const terrain::Terrain> terrain,
                        scheduling::Executor& executor, const Span& span) {
  std::set<std::uint64_t> skipped;
  if (span.from > 0) {
    auto scanned = openRecords(recordings);
    if (!scanned) return scanned.error();
    skipped = endedBefore(**scanned, span.from);
  }
  auto reader = openRecords(recordings);
  if (!reader) return reader.error();
  auto summary = Replaying(std::move(terrain), executor, span, std::move(skipped)).run(**reader);
  if (summary) {
    summary->damage = (*reader)->damage();
    summary->wasCutOff = (*reader)->wasCutOff();
  }
  return summary;
}

Outcome<void> checkTerrain(const World& world, const terrain::Terrain& terrain) {
  const std::uint64_t hash = terrain::contentHash(terrain);
  if (hash == world.contentHash) return {};
  return Error{"The recording was made on terrain " + world.terrain + " with content hash " + text::hexadecimal(world.contentHash) +
               ", but this is " + std::string(terrain.name()) + " with " + text::hexadecimal(hash) +
               ": replay it with the terrain and the version that it was recorded with."};
}

}  // namespace ridgecast::recording
