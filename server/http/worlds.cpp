#include "server/http/worlds.h"

#include <algorithm>
#include <chrono>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/http/lists.h"

namespace ridgecast::http {

namespace {

using session::WorldSpec;

bool upgrades(const Request& request) { return request.upgrade && request.webSocketVersion == "13"; }

// Of a request that would be upgraded if it asked for it.
Answer upgradeRequired() {
  return plain(426, "This is a WebSocket endpoint (version 13): connect with ws://, for example with ridgecast-client.",
               {{"Upgrade", "websocket"}, {"Connection", "Upgrade"}, {"Sec-WebSocket-Version", "13"}});
}

// The URL's world. It may omit the terrain only for an existing session.
struct Wish {
  std::string terrain;
  std::optional<std::uint32_t> seed;
  std::vector<std::pair<std::string, double>> parameters;
  std::optional<wire::ClockMode> clock;

  bool isMetBy(const WorldSpec& spec) const {
    if (!terrain.empty() && terrain != spec.terrain) return false;
    if (seed && *seed != spec.seed) return false;
    return parameters.empty() || parameters == spec.parameters;
  }
};

bool nameIsHarmless(std::string_view name) { return !name.empty() && name.size() <= wire::kMaxNameBytes && text::hasOnly(name, "_-"); }

constexpr std::size_t kMaxParameters = 32;

Outcome<Wish> readWish(std::string_view query) {
  Wish wish;
  const auto terrain = queryParameter(query, "terrain");
  if (!terrain) return terrain.error();
  wish.terrain = *terrain;
  if (!wish.terrain.empty() && !nameIsHarmless(wish.terrain))
    return Error{"A terrain's name has letters, digits, underscores or hyphens; ridgecast-server --list-terrains lists the names."};
  const auto seed = queryParameter(query, "seed");
  if (!seed) return seed.error();
  wish.seed = text::number<std::uint32_t>(*seed);
  if (!seed->empty() && !wish.seed) return Error{"A seed is a whole number from 0 to 4294967295."};
  const auto clock = queryParameter(query, "clock");
  if (!clock) return clock.error();
  for (const auto mode : {wire::ClockMode::kRealTime, wire::ClockMode::kStepped})
    if (*clock == nameOf(mode)) wish.clock = mode;
  if (!clock->empty() && !wish.clock) return Error{"A session's clock begins as clock=real-time, the default, or clock=stepped."};
  const auto assignments = queryParameters(query, "param");
  if (!assignments) return assignments.error();
  for (const std::string& assignment : *assignments) {
    std::string_view rest = assignment;
    const std::string name(text::takePart(rest, '='));
    const auto value = text::number<double>(rest);
    if (!nameIsHarmless(name) || !value) return Error{"A parameter is given as param=NAME=NUMBER."};
    if (wish.parameters.size() >= kMaxParameters) return Error{"A world has at most " + std::to_string(kMaxParameters) + " parameters."};
    wish.parameters.emplace_back(name, *value);
  }
  std::sort(wish.parameters.begin(), wish.parameters.end());
  const auto twice =
      std::adjacent_find(wish.parameters.begin(), wish.parameters.end(), [](const auto& a, const auto& b) { return a.first == b.first; });
  if (twice != wish.parameters.end()) return Error{"The parameter '" + twice->first + "' is given twice; give it once."};
  return wish;
}

std::string describe(const WorldSpec& spec) {
  std::string out = "terrain " + spec.terrain + ", seed " + std::to_string(spec.seed);
  for (const auto& [name, value] : spec.parameters) out += ", " + name + "=" + text::rounded(value, 9);
  return out;
}

std::string otherWorld(const std::string& session, const WorldSpec& spec) {
  return "Session '" + session + "' is another world (" + describe(spec) +
         ") and does not change while it lives; leave the terrain out to join it, or choose another name.";
}

// Why a session with this world cannot be joined with this wish.
std::optional<Answer> notMet(const Wish& wish, const std::string& session, const WorldSpec& spec) {
  if (wish.clock.value_or(spec.clock) != spec.clock)
    return refused(409, metrics::Refusal::kSession,
                   "Session '" + session + "' began with clock=" + nameOf(spec.clock) + "; leave clock=" + nameOf(*wish.clock) +
                       " out to join it, or choose another name.");
  if (!wish.isMetBy(spec)) return refused(409, metrics::Refusal::kSession, otherWorld(session, spec));
  return {};
}

// Joins, if the session has the requested world.
Reply join(std::shared_ptr<session::Session> session, const Wish& wish, const Enter& enter) {
  if (auto other = notMet(wish, session->name(), session->spec())) return std::move(*other);
  return enter(std::move(session));
}

Answer refusedFor(const directory::Directory::Full& full) {
  return refused(full.isOwn ? 429 : 503, metrics::Refusal::kFull, full.sentence);
}

// Others may be compiled.
bool isMadeAtOnce(const std::string& terrain, const std::vector<std::pair<std::string, double>>& parameters) {
  return parameters.empty() && std::ranges::any_of(terrain::builtIn(), [&](const auto& builtIn) { return builtIn.name == terrain; });
}

constexpr std::chrono::milliseconds kNameTaken{10};  // before a name is asked for again

// What the bus answers, awaited between two turns.
template <class T>
class BusAnswer {
 public:
  std::function<void(Outcome<T>)> receiver() const {
    return [state = state_](Outcome<T> value) {
      std::function<void()> wake;
      {
        const std::lock_guard lock(state->mutex);
        state->value = std::move(value);
        wake = std::exchange(state->wake, nullptr);
      }
      if (wake) wake();
    };
  }
  // None: not yet; `wake` is called when it is there.
  std::optional<Outcome<T>> get(const std::function<void()>& wake) const {
    const std::lock_guard lock(state_->mutex);
    if (!state_->value) state_->wake = wake;
    return state_->value;
  }

 private:
  struct State {
    std::mutex mutex;
    std::optional<Outcome<T>> value;
    std::function<void()> wake;
  };
  std::shared_ptr<State> state_ = std::make_shared<State>();
};

// A session in the making: its name is reserved, looked up on all servers, its terrain made, the name claimed for that world. In turns,
// which never wait: not made yet as long as somebody else has the name, or the bus has not answered. Only the one who has the name moves to
// kWorlds, where few may wait, and only if that takes long. The answer to a client that has left is not read: then nothing is made.
class Making : public std::enable_shared_from_this<Making> {
 public:
  Making(std::string name, Wish wish, std::string client, std::optional<Answer> mayNotCreate, directory::Directory& directory, Enter enter,
         bool makes)
      : name_(std::move(name)),
        wish_(std::move(wish)),
        client_(std::move(client)),
        mayNotCreate_(std::move(mayNotCreate)),
        directory_(directory),
        enter_(std::move(enter)),
        makes_(makes) {}

  Reply work() {
    return DeferredResponse{.queue = queue_,
                            .work = [self = shared_from_this()](const Turn& turn) { return self->turn(turn); },
                            .progress = [] { return "preparing the terrain"; }};
  }

  Reply turn(const Turn& turn) {
    if (!reserved_) {
      auto reserved = directory_.reserve(name_);
      if (!reserved) return refused(503, metrics::Refusal::kSession, reserved.error().message, {{"Retry-After", "1"}});
      if (!*reserved) {  // another request was faster
        if (auto session = directory_.find(name_)) return join(std::move(session), wish_, enter_);
        return RetryAt{std::chrono::steady_clock::now() + kNameTaken};
      }
      reserved_ = std::move(*reserved);
      if (directory_.keeps(name_)) return takeLong();  // its edits are read
    }
    if (!found_) directory_.worlds().find(name_, found_.emplace().receiver());
    const auto found = found_->get(turn.wake);
    if (!found) return RetryAt{RetryAt::kWhenWoken};
    if (!*found) return unknown(found->error());
    if ((*found)->live) return follow(*(*found)->live, turn);
    return begin((*found)->kept, turn);
  }

 private:
  Reply takeLong() {
    queue_ = Queue::kWorlds;
    return work();
  }

  Answer unknown(const Error& why) const {
    return refused(503, metrics::Refusal::kSession,
                   "Session '" + name_ + "' is not on this server, and cannot be looked up on the others now: " + why.message,
                   {{"Retry-After", "1"}});
  }

  // A session that lives on another server.
  Reply follow(const directory::SharedWorlds::Standing& live, const Turn& turn) {
    if (auto other = notMet(wish_, name_, live.world.spec)) return std::move(*other);
    if (auto other = otherEdits(live.world)) return std::move(*other);
    if (auto instead = makeTerrain(live.world.spec, turn.stop)) return std::move(*instead);
    if (auto other = otherGround(live.world)) return std::move(*other);
    if (!makes_) return enter_(nullptr);
    reserved_->claim(live, true);
    return add(live.world.maker);
  }

  // One that lives on no server.
  Reply begin(const std::optional<directory::World>& keptByAll, const Turn& turn) {
    std::optional<WorldSpec> kept;  // nobody is in it, but its edits are kept
    if (const edit_log::World* const log = reserved_->kept()) kept = WorldSpec{log->terrain, log->seed, log->parameters};
    if (keptByAll) {
      if (auto other = otherEdits(*keptByAll)) return std::move(*other);
      kept = keptByAll->spec;
    }
    if (kept) {
      kept->clock = wish_.clock.value_or(wire::ClockMode::kRealTime);
      if (auto other = notMet(wish_, name_, *kept)) return std::move(*other);
    }
    if (!kept && wish_.terrain.empty()) return noSession(name_, directory_);
    if (mayNotCreate_) return *mayNotCreate_;
    if (const auto full = directory_.full(client_)) return refusedFor(*full);
    const WorldSpec spec =
        kept.value_or(WorldSpec{wish_.terrain, wish_.seed.value_or(1), wish_.parameters, wish_.clock.value_or(wire::ClockMode::kRealTime)});
    if (auto instead = makeTerrain(spec, turn.stop)) return std::move(*instead);
    if (keptByAll)
      if (auto other = otherGround(*keptByAll)) return std::move(*other);
    if (!makes_) return enter_(nullptr);
    if (!claimed_) {
      proposed_ = directory_.propose(spec, *terrain_, client_);
      directory_.worlds().claim(name_, *proposed_, claimed_.emplace().receiver());
    }
    const auto claimed = claimed_->get(turn.wake);
    if (!claimed) return RetryAt{RetryAt::kWhenWoken};
    if (!*claimed) return unknown(claimed->error());
    if ((*claimed)->world.id != proposed_->id) return follow(**claimed, turn);  // another server was faster
    reserved_->claim(**claimed, false);
    return add(client_);
  }

  // None: it is made.
  std::optional<Reply> makeTerrain(const WorldSpec& spec, const std::stop_token& stop) {
    if (terrain_ && made_ == spec) return {};
    if (queue_ != Queue::kWorlds && !isMadeAtOnce(spec.terrain, spec.parameters)) return takeLong();
    if (!directory_.resources().makeTerrain)
      return refused(403, metrics::Refusal::kSession, "Sessions cannot be created on this server; 'default' always exists.");
    auto terrain = directory_.resources().makeTerrain(spec, stop);
    if (!terrain) return refused(400, metrics::Refusal::kSession, "Session '" + name_ + "' cannot be created: " + terrain.error().message);
    if (stop.stop_requested()) return refused(503, metrics::Refusal::kSession, "Session '" + name_ + "' was not created: its client left.");
    terrain_ = std::move(*terrain);
    made_ = spec;
    return {};
  }

  std::optional<Answer> otherGround(const directory::World& theirs) const {
    const directory::World ours{{}, made_, terrain::contentHash(*terrain_), {}};
    if (ours.hasGroundOf(theirs)) return {};
    return refused(503, metrics::Refusal::kSession,
                   "Session '" + name_ + "' has other ground on the other servers (" + describe(theirs) + ") than this server makes (" +
                       describe(ours) + "): its operator must give all servers the same terrain files.");
  }

  // Of this server's own log, such as from a time when it was alone.
  std::optional<Answer> otherEdits(const directory::World& theirs) const {
    const edit_log::World* const log = reserved_->kept();
    if (!log || (log->terrain == theirs.spec.terrain && log->seed == theirs.spec.seed && log->parameters == theirs.spec.parameters))
      return {};
    return refused(503, metrics::Refusal::kSession,
                   "Session '" + name_ + "' is another world on the other servers (" + describe(theirs) +
                       ") than this server has edits of: its operator must move '" + name_ + ".edits' out of its --state folder.");
  }

  Reply add(const std::string& maker) {
    const auto added = directory_.add(std::move(reserved_), terrain_, made_.parameters, maker, made_.clock);
    if (added) return enter_(*added);
    const auto full = directory_.full(maker);
    return full ? refusedFor(*full) : refused(503, metrics::Refusal::kFull, added.error().message);
  }

  Queue queue_ = Queue::kPrompt;
  const std::string name_;
  const Wish wish_;
  const std::string client_;
  const std::optional<Answer> mayNotCreate_;
  directory::Directory& directory_;
  const Enter enter_;
  const bool makes_;
  std::unique_ptr<directory::Reservation> reserved_;
  std::optional<BusAnswer<directory::SharedWorlds::Found>> found_;
  std::shared_ptr<const terrain::Terrain> terrain_;
  WorldSpec made_;  // of terrain_
  std::optional<directory::World> proposed_;
  std::optional<BusAnswer<directory::SharedWorlds::Standing>> claimed_;
};

}  // namespace

Reply inSession(const Request& request, directory::Directory& directory, const Enter& then, bool makes) {
  const Enter enter = [then, edit = std::string(request.edit)](const std::shared_ptr<session::Session>& session) -> Reply {
    if (!session) return then(nullptr);
    return onceHas(edit, session, [then, session] { return then(session); });
  };
  const auto name = queryParameter(request.query(), "session");
  if (!name) return refused(400, metrics::Refusal::kSession, name.error().message);
  const std::string wanted = name->empty() ? std::string(directory::kDefaultName) : *name;
  if (!wire::sessionNameIsValid(wanted))
    return refused(
        400, metrics::Refusal::kSession,
        "A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens.");
  auto wish = readWish(request.query());
  if (!wish) return refused(400, metrics::Refusal::kSession, wish.error().message);
  if (auto session = directory.find(wanted)) return join(std::move(session), *wish, enter);
  const bool isKept = directory.keeps(wanted);
  if (wanted == directory::kDefaultName || (!directory.isShared() && wish->terrain.empty() && !isKept)) return noSession(wanted, directory);
  std::optional<Answer> mayNotCreate;
  if (!request.rights.has(access::Right::kCreate))
    mayNotCreate =
        refused(403, metrics::Refusal::kRight, "There is no session named '" + wanted + "', and the token lacks the right 'create'.");
  else if (!directory.resources().makeTerrain)
    mayNotCreate = refused(403, metrics::Refusal::kSession, "Sessions cannot be created on this server; 'default' always exists.");
  const std::string client(request.client);
  if (!directory.isShared()) {  // nobody else has it
    if (mayNotCreate) return *mayNotCreate;
    if (const auto full = directory.full(client)) return refusedFor(*full);
  }
  const bool atOnce = !directory.isShared() && !isKept && isMadeAtOnce(wish->terrain, wish->parameters);
  const auto making = std::make_shared<Making>(wanted, std::move(*wish), client, std::move(mayNotCreate), directory, enter, makes);
  if (atOnce)
    if (Reply made = making->turn({}); !std::holds_alternative<RetryAt>(made)) return made;
  return making->work();
}

std::optional<std::string> missingHere(const Request& request, const directory::Directory& directory) {
  constexpr std::string_view kPrefix = "/v1/sessions/";
  std::string_view rest = request.path();
  if (!directory.isShared() || request.method == "OPTIONS" || !rest.starts_with(kPrefix)) return {};
  rest.remove_prefix(kPrefix.size());
  std::string name(text::takePart(rest, '/'));
  if (rest.empty() || rest.starts_with("members") || !wire::sessionNameIsValid(name) || directory.find(name)) return {};
  return name;
}

Reply fromElsewhere(const std::string& name, const Request& request, directory::Directory& directory, const Enter& enter) {
  return std::make_shared<Making>(name, Wish{}, std::string(request.client), noSession(name, directory), directory, enter, true)->work();
}

namespace {

class TakingUp {
 public:
  explicit TakingUp(directory::Directory& directory) : directory_(directory), nothingHeard_(directory.others()) {}

  Reply turn(const Turn& turn) {
    while (Clock::now() < until_) {
      if (!work_) {
        if (!names_ && !listNames()) return RetryAt{Clock::now() + kPause};
        if (names_->empty() && areCurrent()) break;
        if (names_->empty()) return RetryAt{Clock::now() + kPause};
        begin(names_->extract(names_->begin()).value());
      }
      Reply reply = work_(turn);
      if (const auto* retry = std::get_if<RetryAt>(&reply)) return RetryAt{std::min(retry->time, until_)};
      auto* next = std::get_if<DeferredResponse>(&reply);
      work_ = next ? std::move(next->work) : nullptr;
    }
    return Answer{};
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kTakingUp{10};
  static constexpr std::chrono::milliseconds kPause{10};

  bool listNames() {
    const auto others = directory_.others();
    if (others == nothingHeard_) return false;
    names_.emplace();
    for (const auto& server : *others)
      for (const auto& [name, session] : server.sessions)
        if (!directory_.find(name) && directory_.keeps(name)) names_->insert(name);
    return true;
  }

  bool areCurrent() const {
    return std::ranges::all_of(directory_.all(), [](const auto& session) { return session->isCurrent(); });
  }

  void begin(const std::string& name) {
    const Enter enter = [](const std::shared_ptr<session::Session>& session) -> Reply {
      session->use();
      return Answer{};
    };
    const auto making = std::make_shared<Making>(name, Wish{}, std::string(), noSession(name, directory_), directory_, enter, true);
    work_ = [making](const Turn& turn) { return making->turn(turn); };
  }

  directory::Directory& directory_;
  const std::shared_ptr<const std::vector<directory::ServerStatus>> nothingHeard_;
  const Clock::time_point until_ = Clock::now() + kTakingUp;
  std::optional<std::set<std::string>> names_;
  std::function<Reply(const Turn&)> work_;
};

}  // namespace

std::function<Reply(const Turn&)> takingUp(directory::Directory& directory) {
  return [state = std::make_shared<TakingUp>(directory)](const Turn& turn) { return state->turn(turn); };
}

Outcome<earth::Coordinates> coordinatesOf(const session::Session& session, std::string_view crs) {
  const auto terrain = session.ground().terrain;
  return earth::Coordinates::of(session.resources().limits.sendsTerrain ? terrain->raster() : nullptr, crs);
}

namespace {

// The stream of a client that may come from another server, once this one has all edits that the log of both ends with now. While the
// engine is away it has what it has.
Reply upgradeOnceThere(std::shared_ptr<session::Session> session) {
  bus::Bus& bus = *session->resources().bus;
  if (bus.server() == 0) return Upgrade{std::move(session)};
  BusAnswer<std::vector<bus::Entry>> read;
  bus.read(session->name(), session->ground().edit, editing::EditOrder::kPageBytes, read.receiver());
  return DeferredResponse{.work = [session = std::move(session), read](const Turn& turn) -> Reply {
    const auto entries = read.get(turn.wake);
    if (!entries) return RetryAt{RetryAt::kWhenWoken};
    const auto go = [session]() -> Reply { return Upgrade{session}; };
    const std::uint64_t last = *entries && !(*entries)->empty() ? (*entries)->back().number : 0;
    return session->ground().edit < last ? onceHas(std::to_string(last), session, go) : go();
  }};
}

}  // namespace

Reply streamAnswer(const Request& request, directory::Directory& directory) {
  const bool upgrading = upgrades(request);
  const auto enter = [upgrading](std::shared_ptr<session::Session> session) -> Reply {
    if (upgrading) return upgradeOnceThere(std::move(session));
    return upgradeRequired();
  };
  return inSession(request, directory, enter, upgrading);
}

}  // namespace ridgecast::http
