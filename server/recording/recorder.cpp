#include "server/recording/recorder.h"

#include <fcntl.h>
#include <pthread.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <ctime>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "common/outcome/contract.h"
#include "server/logging/logging.h"
#include "server/recording/format.h"
#include "server/recording/reader.h"
#include "server/scheduling/pool.h"

namespace ridgecast::recording {

namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kEvery{1000};         // between two blocks of a recording
constexpr std::size_t kFullBlock = 256u << 10;            // of records: written at once
constexpr std::size_t kEventBytes = sizeof(Record) + 64;  // in the queue, about

std::size_t bytesOf(const Edited& edited) { return edited.author.size() + edited.operation.size(); }

std::size_t bytesOf(const Event& event) {
  std::size_t bytes = kEventBytes;
  if (const auto* e = std::get_if<Iterated>(&event)) bytes += e->changed.size() * sizeof(lattice::Area);
  if (const auto* e = std::get_if<Edited>(&event)) bytes += bytesOf(*e);
  if (const auto* e = std::get_if<Asked>(&event)) bytes += e->message.size();
  return bytes;
}

std::string stampOf(std::int64_t microseconds) {
  const std::time_t seconds = microseconds / 1'000'000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[48];
  std::snprintf(text, sizeof text, "%04d%02d%02dT%02d%02d%02d.%06d", utc.tm_year + 1900, utc.tm_mon + 1, utc.tm_mday, utc.tm_hour,
                utc.tm_min, utc.tm_sec, static_cast<int>(microseconds % 1'000'000));
  return text;
}

}  // namespace

// One session's recording. The writing thread's but for what `ended` says.
struct Writing {
  std::string session, name;
  World world;
  Observer::Instant began;
  std::atomic<bool> ended{false};  // takes nothing more
  struct File {
    int descriptor = -1;
    std::uint64_t size = 0;
    Bytes block;  // to be written
  };
  bool isClosed = false;  // nothing more is written

  // What a part begins with.
  std::vector<Edited> past;  // until the first part begins
  std::uint64_t lastEdit = 0;
  std::optional<Record> clock;
  std::map<std::uint64_t, Joined> members;
  File edits, part;
  unsigned number = kEditsPart;  // of the part
  Encoder encoder;
  Observer::Instant written{};
};

struct Recorder::State {
  fs::path folder;
  std::uint64_t bytes = 0, partBytes = 0;
  int folderLock = -1;  // -1: its file system has none

  std::mutex mutex;
  std::condition_variable changed;
  struct Waiting {
    std::shared_ptr<Writing> of;
    Record record;
    bool isEnd = false;
  };
  std::vector<Waiting> waiting;
  std::size_t waitingBytes = 0;
  bool ends = false;
  Usage usage;
  std::atomic<std::uint64_t> failed{0};  // recordings
  std::thread thread;

  // The thread's.
  std::map<const Writing*, std::shared_ptr<Writing>> open;
  std::deque<std::pair<fs::path, std::uint64_t>> old;  // closed parts, the oldest first, with their bytes
  std::uint64_t total = 0;                             // of all parts

  bool push(const std::shared_ptr<Writing>& of, Record&& record, bool isEnd);
  void run();
  void take(Waiting& w);
  void apply(Writing& w, const Event& event);
  // These end the recording, and say so, where they return false.
  bool make(Writing& w, Writing::File& file, unsigned number);
  bool keep(Writing& w, const Edited& edited);   // in the file of edits
  bool begin(Writing& w);                        // the next part
  bool append(Writing& w, Writing::File& file);  // its block
  bool write(Writing& w);                        // the part's block
  bool flush(Writing& w);                        // likewise; a full part is followed by the next
  bool makeRoom(std::uint64_t bytes);
  void close(Writing& w);
  void close(Writing& w, Writing::File& file, unsigned number);
  void fail(Writing& w, const std::string& why);  // takes nothing more, and says so. Any thread
  bool stop(Writing& w, const std::string& why);  // false
  bool end(Writing& w, const std::string& why);   // likewise, once the part's block is written
};

class Recorder::Session final : public Observer {
 public:
  Session(std::shared_ptr<State> state, std::shared_ptr<Writing> writing) : state_(std::move(state)), writing_(std::move(writing)) {}
  ~Session() override { state_->push(writing_, {}, true); }
  void note(Instant when, Event event) override {
    if (writing_->ended) return;
    const auto time = std::chrono::duration_cast<std::chrono::microseconds>(when - writing_->began).count();
    if (!state_->push(writing_, {time, std::move(event)}, false)) state_->fail(*writing_, "the disk is slower than what is to be recorded");
  }

 private:
  const std::shared_ptr<State> state_;
  const std::shared_ptr<Writing> writing_;
};

Outcome<std::unique_ptr<Recorder>> Recorder::open(const fs::path& folder, std::uint64_t bytes) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (!fs::is_directory(folder, failed)) return Error{"--record '" + folder.string() + "' is not a folder and cannot be created."};
  if (access(folder.c_str(), W_OK) != 0)
    return Error{"--record '" + folder.string() + "' cannot be written: " + std::strerror(errno) + "."};
  const int folderLock = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folderLock >= 0 && flock(folderLock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    ::close(folderLock);
    return Error{"--record '" + folder.string() + "' is in use by another program; stop the server that has it, or name another folder."};
  }
  auto state = std::make_shared<State>();
  state->folderLock = folderLock;
  state->folder = folder;
  state->bytes = std::max(bytes, kMinBytes);
  state->partBytes = state->bytes / 16;
  std::map<std::string, std::vector<std::pair<fs::file_time_type, fs::path>>> found;  // by recording
  for (const auto& entry : fs::directory_iterator(folder, failed))
    if (const auto name = nameOf(entry.path())) found[name->first].emplace_back(entry.last_write_time(failed), entry.path());
  std::vector<std::tuple<fs::file_time_type, bool, fs::path>> inOrder;
  for (const auto& [name, files] : found)
    for (const auto& [time, file] : files)
      if (const bool isEdits = nameOf(file)->second == kEditsPart)  // which go after all parts that need them
        inOrder.emplace_back(std::ranges::max(files).first, isEdits, file);
      else
        inOrder.emplace_back(time, isEdits, file);
  std::ranges::sort(inOrder);
  for (const auto& [time, isEdits, file] : inOrder) {
    state->old.emplace_back(file, fs::file_size(file, failed));
    state->total += state->old.back().second;
  }
  state->usage.keptBytes = state->total;
  return std::unique_ptr<Recorder>(new Recorder(std::move(state)));
}

Recorder::Recorder(std::shared_ptr<State> state) : state_(std::move(state)) {
  state_->thread = std::thread([s = state_.get()] { s->run(); });
}

Recorder::~Recorder() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->ends = true;
  }
  state_->changed.notify_all();
  state_->thread.join();
  if (state_->folderLock >= 0) ::close(state_->folderLock);
}

Recorder::Usage Recorder::usage() const {
  const std::lock_guard lock(state_->mutex);
  Usage usage = state_->usage;
  usage.waitingBytes = state_->waitingBytes;
  usage.failed = state_->failed;
  return usage;
}

std::shared_ptr<Observer> Recorder::begin(World world, std::vector<Edited> past, Observer::Instant now) {
  auto writing = std::make_shared<Writing>();
  writing->began = now;
  world.began = std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  writing->session = world.session;
  writing->name = world.session + "." + stampOf(world.began);
  writing->world = std::move(world);
  writing->past = std::move(past);
  return std::make_shared<Session>(state_, std::move(writing));
}

bool Recorder::State::push(const std::shared_ptr<Writing>& of, Record&& record, bool isEnd) {
  const std::lock_guard lock(mutex);
  const std::size_t size = bytesOf(record.event);
  if (!isEnd && waitingBytes + size > kMaxWaiting) return false;
  waitingBytes += size;
  waiting.push_back({of, std::move(record), isEnd});
  if (waitingBytes > kMaxWaiting / 4) changed.notify_all();
  return true;
}

void Recorder::State::run() {
  scheduling::lowerPriority(10);
  pthread_setname_np(pthread_self(), "recorder");
  for (bool isLast = false; !isLast;) {
    std::vector<Waiting> taken;
    {
      std::unique_lock lock(mutex);
      changed.wait_for(lock, kEvery / 2, [&] { return ends || waitingBytes > kMaxWaiting / 4; });
      isLast = ends;
      taken.swap(waiting);
      waitingBytes = 0;
    }
    for (Waiting& w : taken) take(w);
    const auto now = Observer::Instant::clock::now();
    const auto written = open;  // flush() may end one
    for (const auto& [key, w] : written)
      if (isLast)
        write(*w);
      else if (now - w->written >= kEvery)
        flush(*w);
    timespec spent{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &spent);
    const std::lock_guard lock(mutex);
    usage.keptBytes = total;
    usage.seconds = static_cast<double>(spent.tv_sec) + static_cast<double>(spent.tv_nsec) / 1e9;
  }
  while (!open.empty()) close(*open.begin()->second);
}

void Recorder::State::take(Waiting& waits) {
  expects(waits.of != nullptr, "a record is of a recording");
  Writing& w = *waits.of;
  if (waits.isEnd) {
    if (open.contains(&w) && write(w)) close(w);
    return;
  }
  if (w.isClosed) return;
  if (!open.contains(&w)) {
    open.emplace(&w, waits.of);
    const auto past = std::exchange(w.past, {});
    if (!std::ranges::all_of(past, [&](const Edited& e) { return keep(w, e); }) || !begin(w)) return;
  }
  if (const auto* edited = std::get_if<Edited>(&waits.record.event); edited && !keep(w, *edited)) return;
  apply(w, waits.record.event);
  if (std::holds_alternative<Clocked>(waits.record.event)) w.clock = waits.record;
  w.encoder.put(waits.record, w.part.block);
  if (w.part.block.size() >= kFullBlock) flush(w);
}

// What the next part must know.
void Recorder::State::apply(Writing& w, const Event& event) {
  if (const auto* joined = std::get_if<Joined>(&event)) {
    Joined& known = w.members[joined->camera] = *joined;
    known.again = true;
  } else if (const auto* left = std::get_if<Left>(&event)) {
    w.members.erase(left->camera);
  } else if (const auto* iterated = std::get_if<Iterated>(&event)) {
    const auto member = w.members.find(iterated->camera);
    if (member == w.members.end()) return;
    if (iterated->granted) member->second.granted = *iterated->granted;
    member->second.edit = iterated->edit;
  }
}

bool Recorder::State::make(Writing& w, Writing::File& file, unsigned number) {
  expects(file.descriptor < 0 && !w.isClosed, "a part is made of a recording that goes on, when the one before is closed");
  const fs::path path = folder / partName(w.name, number);
  file.descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0644);
  if (file.descriptor < 0) return stop(w, "'" + path.string() + "' cannot be made: " + std::strerror(errno));
  file.size = 0;
  return true;
}

bool Recorder::State::keep(Writing& w, const Edited& edited) {
  if (w.edits.descriptor < 0) {
    if (!make(w, w.edits, kEditsPart)) return false;
    Encoder().put({0, w.world}, w.edits.block);
  }
  if (!Encoder().put({0, edited}, w.edits.block)) return end(w, "an edit has more than " + std::to_string(kMaxRecordBytes) + " bytes");
  w.lastEdit = edited.number;
  return w.edits.block.size() < kFullBlock || append(w, w.edits);
}

bool Recorder::State::begin(Writing& w) {
  if (!append(w, w.edits) || !make(w, w.part, ++w.number)) return false;
  if (w.number == 1) logging::info({.session = w.session}, "is recorded to " + (folder / partName(w.name, 1)).string());
  w.encoder = {};
  w.written = Observer::Instant::clock::now();
  const std::int64_t time = w.clock ? w.clock->time : 0;
  w.encoder.put({time, w.world}, w.part.block);
  if (w.lastEdit > 0) w.encoder.put({time, EditsBefore{w.lastEdit}}, w.part.block);
  if (w.clock) w.encoder.put(*w.clock, w.part.block);
  for (const auto& [camera, joined] : w.members) w.encoder.put({time, joined}, w.part.block);
  return true;
}

bool Recorder::State::append(Writing& w, Writing::File& file) {
  if (file.block.empty()) return true;
  expects(file.descriptor >= 0, "what is written has a file");
  const Bytes frame = compress(file.block);
  file.block.clear();
  if (&file == &w.edits && file.size + frame.size() > bytes / 2)
    return end(w, "its edits alone have more than " + std::to_string(bytes / 2) + " bytes; --record-bytes can be raised");
  if (!makeRoom(frame.size())) return stop(w, "no room is left in --record-bytes beside what else is being recorded");
  for (std::size_t done = 0; done < frame.size();) {
    const ssize_t n = ::write(file.descriptor, frame.data() + done, frame.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return stop(w, std::string("it cannot be written: ") + std::strerror(errno));
    done += static_cast<std::size_t>(n);
  }
  file.size += frame.size();
  total += frame.size();
  const std::lock_guard lock(mutex);
  usage.bytes += frame.size();
  return true;
}

bool Recorder::State::write(Writing& w) {
  w.written = Observer::Instant::clock::now();
  return append(w, w.part);
}

bool Recorder::State::flush(Writing& w) {
  if (!write(w)) return false;
  if (w.part.size < partBytes) return true;
  close(w, w.part, w.number);
  return begin(w);
}

bool Recorder::State::makeRoom(std::uint64_t more) {
  while (total + more > bytes && !old.empty()) {
    std::error_code ignored;
    fs::remove(old.front().first, ignored);
    expects(total >= old.front().second, "closed parts are counted");
    total -= old.front().second;
    old.pop_front();
  }
  return total + more <= bytes;
}

void Recorder::State::close(Writing& w, Writing::File& file, unsigned number) {
  if (file.descriptor < 0) return;
  ::close(std::exchange(file.descriptor, -1));
  old.emplace_back(folder / partName(w.name, number), file.size);
}

void Recorder::State::close(Writing& w) {
  close(w, w.part, w.number);
  close(w, w.edits, kEditsPart);  // after all parts that need it
  if (w.number == 0 && w.edits.size > 0) {
    std::error_code ignored;
    fs::remove(old.back().first, ignored);
    total -= old.back().second;
    old.pop_back();
  }
  w.ended = w.isClosed = true;
  open.erase(&w);
}

bool Recorder::State::stop(Writing& w, const std::string& why) {
  fail(w, why);
  close(w);
  return false;
}

void Recorder::State::fail(Writing& w, const std::string& why) {
  if (w.ended.exchange(true)) return;
  ++failed;
  logging::error({.session = w.session}, "the recording ends: " + why);
}

bool Recorder::State::end(Writing& w, const std::string& why) { return write(w) && stop(w, why); }

}  // namespace ridgecast::recording
