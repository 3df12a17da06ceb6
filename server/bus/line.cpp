#include "server/bus/line.h"

#include <algorithm>
#include <random>
#include <utility>

#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "server/bus/redis.h"
#include "server/bus/scripts.h"
#include "server/logging/logging.h"

namespace ridgecast::bus {

namespace asio = boost::asio;
using namespace std::chrono_literals;

namespace {

constexpr auto kFirstPatience = 6s;  // more than a grace
constexpr auto kTick = 500ms, kMinPause = 50ms, kMaxPause = 1000ms;
constexpr auto kMeasureEvery = 1s;
constexpr std::size_t kSamples = 8;
constexpr std::size_t kServerBytes = 4;  // at the front of a message: who sent it
constexpr std::uint32_t kServers = 1u << 20;

const std::array<std::string_view, Line::kScripts> kTexts{scripts::append, scripts::read, scripts::last, scripts::hold,
                                                          scripts::take,   scripts::drop, scripts::list, scripts::arrive};

std::int64_t microseconds(std::chrono::steady_clock::time_point time) {
  return std::chrono::duration_cast<std::chrono::microseconds>(time.time_since_epoch()).count();
}

std::string randomName() {
  std::random_device random;
  return text::hexadecimal((std::uint64_t{random()} << 32) | random());
}

// "name:value" of INFO; empty: it lacks it.
std::string_view valueOf(std::string_view info, std::string_view name) {
  while (!info.empty()) {
    std::string_view line = text::trimmed(text::takePart(info, '\n'));
    if (text::takePart(line, ':') == name) return line;
  }
  return {};
}

bool beginsWithAny(std::string_view text, std::initializer_list<std::string_view> words) {
  return std::any_of(words.begin(), words.end(), [&](std::string_view word) { return text.starts_with(word); });
}

std::string senderOf(std::uint32_t server) {
  std::string out(kServerBytes, '\0');
  for (std::size_t i = 0; i < kServerBytes; ++i) out[i] = static_cast<char>(server >> (8 * i));
  return out;
}

}  // namespace

struct Line::Handler {
  std::weak_ptr<Line> line;
  std::string channel;
  std::function<void(std::uint64_t)> changed;
  std::function<void(const std::string&)> heard;

  ~Handler() {
    if (const auto there = line.lock()) there->post([l = there.get(), c = std::move(channel)] { l->tidy(c); });
  }
};

Line::Line(Address address, std::string ca, metrics::Metrics& figures)
    : address_(std::move(address)),
      ca_(std::move(ca)),
      connected_(figures.registry.gauge("ridgecast_bus_connected", "1 if the engine of --shared is there.")),
      reconnects_(figures.registry.counter("ridgecast_bus_reconnects_total", "How often the engine of --shared came back.")),
      awaySeconds_(
          figures.registry.counter("ridgecast_bus_away_seconds_total", "Seconds without the engine of --shared, after the first.")),
      memory_(figures.registry.gauge("ridgecast_bus_memory_bytes", "What the engine of --shared uses, as it said last.")),
      memoryLimit_(figures.registry.gauge("ridgecast_bus_memory_limit_bytes", "What the engine of --shared may use; 0: unlimited.")),
      ownChannel_(channelOf("server", randomName())) {}

std::optional<Error> Line::start() {
  auto first = first_.emplace().get_future();
  post([this] { dial(), tick(); });
  thread_ = std::thread([self = shared_from_this()] { self->io_.run(); });
  std::optional<Error> error;
  if (first.wait_for(kFirstPatience) == std::future_status::ready) {
    error = first.get();
    if (!error) return error;
    stop();
  } else {
    stop();
    error = Error{fault_.why.empty() ? "it does not answer" : fault_.why};
  }
  error->message = "The engine at " + address_.text() + " cannot be used: " + error->message + ".";
  return error;
}

void Line::stop() {
  if (!thread_.joinable()) return;
  const bool isHandler = thread_.get_id() == std::this_thread::get_id();  // which drops the last owner of the bus
  if (!isHandler) {
    const auto answered = std::make_shared<std::promise<void>>();
    send(command({"PING"}), [answered](const Answer&) { answered->set_value(); });
    answered->get_future().wait_for(kFarewell);
  }
  hasEnded_ = true;
  io_.stop();
  isHandler ? thread_.detach() : thread_.join();
  for (const auto& link : {commands_, subscriptions_})
    if (link) link->abandon();
  if (isHandler) return;
  io_.restart();
  io_.poll();  // what waits ends here, without a word: its owners may own this line
}

std::int64_t Line::now() const { return microseconds(Clock::now()) + ahead_; }

// ---- opening and losing ----

void Line::dial() {
  stage_ = Stage::kOpening;
  opened_ = asked_ = 0;
  const auto link = [this](std::function<void(const Reply&)> push) {
    const auto opened = [this] {
      if (++opened_ == 2) next();
    };
    return std::make_shared<Link>(io_, address_, ca_, Link::Events{opened, std::move(push), [this](const Link::Fault& f) { lost(f); }});
  };
  commands_ = link({});
  subscriptions_ = link([this](const Reply& reply) { pushed(reply); });
  commands_->open();
  subscriptions_->open();
}

void Line::lost(const Link::Fault& fault) {
  if (stage_ == Stage::kAway) return;
  const bool wasThere = std::exchange(stage_, Stage::kAway) == Stage::kThere;
  isAway_ = true;
  fault_ = fault;
  const auto links = {std::exchange(commands_, nullptr), std::exchange(subscriptions_, nullptr)};
  for (const auto& link : links) link->end({});
  if (wasThere) {
    leftAt_ = countedTo_ = Clock::now();
    connected_.Set(0);
    logging::warning("the engine at " + address_.text() + " is away: " + fault.why + "; edits wait for it, meshes go on");
  }
  if (first_ && fault.isFinal) return first_->set_value(Error{fault.why});  // start() ends it
  redial_.expires_after(pause_);
  redial_.async_wait([this](const boost::system::error_code& ec) {
    if (!ec && !hasEnded_) dial();
  });
  pause_ = std::clamp<std::chrono::milliseconds>(2 * pause_, kMinPause, kMaxPause);
}

void Line::tick() {
  if (hasEnded_) return;
  for (const auto& link : {commands_, subscriptions_})
    if (link) link->tick();
  if (stage_ == Stage::kThere) {
    if (!asksTime_) askTime();
    if (Clock::now() - measuredAt_ >= kMeasureEvery) {
      measuredAt_ = Clock::now();
      commands_->send(command({"INFO", "memory"}), [this, known = written_.load()](const Answer& answer) {
        measure(answer.reply);
        written_ -= known;
      });
    }
    if (subscriptions_->isIdle()) subscriptions_->send(command({"PING"}), [](const Answer&) {});
  }
  if (stage_ != Stage::kThere && !first_) countAway();
  tick_.expires_after(kTick);
  tick_.async_wait([this](const boost::system::error_code& ec) {
    if (!ec) tick();
  });
}

// ---- greeting ----

void Line::next() {
  stage_ = static_cast<Stage>(static_cast<int>(stage_) + 1);
  switch (stage_) {
    case Stage::kGreeting:
      return greet();
    case Stage::kSubscribing:
      ask(*subscriptions_, {"SUBSCRIBE", ownChannel_}, [this](const Reply& reply) { isGood(reply); });
      for (const auto& [channel, topic] : topics_) subscribeNow(channel);
      return;
    case Stage::kArriving:
      return arrive();
    case Stage::kThere:
      pause_ = {};
      isAway_ = false;
      connected_.Set(1);
      if (first_) {
        first_->set_value(std::nullopt);
        first_.reset();
      } else {
        reconnects_.Increment();
        countAway();
        const auto away = std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - leftAt_);
        logging::info("the engine at " + address_.text() + " is back after " + std::to_string(away.count()) + " ms");
      }
      for (const auto& [channel, topic] : topics_)
        if (!topic.log.empty()) askLast(channel);
      return;
    default:
      expects(false, "the stages of a line follow each other");
  }
}

void Line::ask(Link& link, const std::vector<std::string_view>& words, std::function<void(const Reply&)> use) {
  ++asked_;
  link.send(command(words), [this, use = std::move(use)](const Answer& answer) {
    if (answer.kind != Answer::Kind::kReply) return;  // lost() was there
    use(answer.reply);
    if (stage_ != Stage::kAway && --asked_ == 0) next();
  });
}

bool Line::isGood(const Reply& reply) {
  if (!reply.isError()) return true;
  const bool isFinal = beginsWithAny(reply.text, {"NOPERM", "NOAUTH", "WRONGPASS", "ERR unknown command"});
  lost({"it answers '" + text::oneLine(reply.text) + "'" + (isFinal ? "; its user needs the rights that server/README.md lists" : ""),
        isFinal});
  return false;
}

void Line::greet() {
  samples_.clear();
  asksTime_ = false;
  ask(*commands_, {"INFO"}, [this](const Reply& reply) { checkEngine(reply); });
  ask(*commands_, {"CONFIG", "GET", "appendonly", "appendfsync", "no-appendfsync-on-rewrite", "maxmemory-policy"},
      [this](const Reply& reply) { checkSettings(reply); });
  for (std::size_t i = 0; i < kScripts; ++i)
    ask(*commands_, {"SCRIPT", "LOAD", kTexts[i]}, [this, i](const Reply& reply) {
      if (isGood(reply) && first_) hashes_[i] = reply.text;
    });
  askTime();
}

void Line::checkEngine(const Reply& info) {
  if (!isGood(info)) return;
  const std::string_view version = valueOf(info.text, "redis_version");
  const auto major = text::number<unsigned>(version.substr(0, version.find('.')));
  if (!major || *major < 7) return lost({"it is not Redis 7.0 or newer but '" + text::oneLine(version) + "'", true});
  if (valueOf(info.text, "redis_mode") == "cluster")
    return lost({"it is a Redis Cluster, whose keys are on several engines; one Redis, with replicas if you like, is right", true});
  if (valueOf(info.text, "loading") == "1") return lost({"it still loads its data"});
  if (valueOf(info.text, "role") != "master") return lost({"it is a replica; the address must be its master's"});
  engine_ = valueOf(info.text, "run_id");
  measure(info);
}

void Line::measure(const Reply& info) {
  const auto used = text::number<std::uint64_t>(valueOf(info.text, "used_memory")),
             limit = text::number<std::uint64_t>(valueOf(info.text, "maxmemory"));
  if (used) memory_.Set(static_cast<double>(*used));
  if (limit) memoryLimit_.Set(static_cast<double>(*limit));
  used_ = used.value_or(0);
  limit_ = limit.value_or(0);
}

bool Line::isNearlyFull() const { return limit_ > 0 && used_ + written_ > limit_ - limit_ / 16; }

void Line::countAway() {
  const auto now = Clock::now();
  awaySeconds_.Increment(std::chrono::duration<double>(now - std::exchange(countedTo_, now)).count());
}

void Line::checkSettings(const Reply& settings) {
  constexpr std::string_view kRight =
      "appendonly yes, appendfsync always, no-appendfsync-on-rewrite no and maxmemory-policy noeviction, see server/README.md";
  if (settings.isError()) {
    if (first_) logging::warning("the engine does not say how it is set up; it must have " + std::string(kRight));
    return;
  }
  std::string wrong;
  for (std::size_t i = 0; i + 1 < settings.parts.size(); i += 2) {
    const std::string_view name = settings.part(i), value = settings.part(i + 1);
    const bool isRight = name == "appendonly"                  ? value == "yes"
                         : name == "appendfsync"               ? value == "always"
                         : name == "no-appendfsync-on-rewrite" ? value == "no"
                         : name == "maxmemory-policy"          ? value == "noeviction"
                                                               : true;
    if (!isRight) wrong += (wrong.empty() ? "" : ", ") + text::oneLine(name) + " " + text::oneLine(value);
  }
  if (wrong.empty()) return;
  wrong = "it would lose what it has acknowledged, for it has " + wrong + " instead of " + std::string(kRight);
  if (first_) return lost({wrong, true});
  logging::error("the engine at " + address_.text() + " is in use although " + wrong);  // a world that goes on is better than none
}

void Line::arrive() {
  const std::string number = std::to_string(server_), grace = std::to_string(std::chrono::milliseconds(Redis::kGrace).count());
  commands_->send(commandOf(Script::kArrive, {"ridgecast:engine", "ridgecast:grace", "ridgecast:era", "ridgecast:servers"},
                            {engine_, known_, number, grace}),
                  [this](const Answer& answer) {
                    if (answer.kind != Answer::Kind::kReply || !isGood(answer.reply)) return;
                    arrived(answer.reply);
                  });
}

void Line::arrived(const Reply& reply) {
  if (reply.integer == 0) return lost({"it has just come back, and takes new servers two seconds after that"});
  if (reply.integer < 0 || reply.integer >= kServers)
    return lost({"it has no server's number left; delete its key 'ridgecast:servers' while no server runs", true});
  server_ = static_cast<std::uint32_t>(reply.integer);
  known_ = engine_;
  next();
}

// ---- the clock ----

void Line::askTime() {
  asksTime_ = true;
  commands_->send(command({"TIME"}), [this, sent = Clock::now()](const Answer& answer) {
    asksTime_ = false;
    const auto seconds = text::number<std::int64_t>(answer.reply.part(0)), more = text::number<std::int64_t>(answer.reply.part(1));
    if (!seconds || !more || *seconds < 0 || *seconds > 1'000'000'000'000) return;
    const std::int64_t before = microseconds(sent), after = microseconds(Clock::now());
    samples_.push_back({after - before, *seconds * 1'000'000 + *more - (before + after) / 2});
    if (samples_.size() > kSamples) samples_.pop_front();
    // The reply that was fastest knows best.
    ahead_ = std::min_element(samples_.begin(), samples_.end(), [](const Sample& a, const Sample& b) { return a.delay < b.delay; })->ahead;
  });
}

// ---- calls ----

std::string Line::commandOf(Script script, const std::vector<std::string_view>& keys,
                            const std::vector<std::string_view>& arguments) const {
  const std::string count = std::to_string(keys.size());
  std::vector<std::string_view> words{"EVALSHA", hashes_[static_cast<std::size_t>(script)], count};
  words.insert(words.end(), keys.begin(), keys.end());
  words.insert(words.end(), arguments.begin(), arguments.end());
  return command(words);
}

void Line::call(Script script, const std::vector<std::string_view>& keys, const std::vector<std::string_view>& arguments, Done done) {
  send(commandOf(script, keys, arguments), std::move(done));
}

void Line::publish(std::string_view channel, std::string_view message, Done done) {
  const std::string whole = senderOf(server_) + std::string(message);
  send(command({"PUBLISH", channel, whole}), std::move(done));
}

std::string Line::channelOf(std::string_view kind, std::string_view name) const {
  return "ridgecast:" + std::to_string(address_.database) + ":" + std::string(kind) + ":" + std::string(name);
}

void Line::post(std::function<void()> run) {
  if (hasEnded_) return;
  asio::post(io_, [this, run = std::move(run)] {
    if (!hasEnded_) run();
  });
}

void Line::send(std::string bytes, Done done) {
  if (hasEnded_) return;
  // What it takes of the bounds is given back with the last copy of what waits for the answer.
  const std::size_t calls = ++waiting_->calls, total = waiting_->bytes += bytes.size();
  const std::shared_ptr<const void> place(nullptr, [w = waiting_, size = bytes.size()](const void*) { --w->calls, w->bytes -= size; });
  const bool fits = calls <= Redis::kMaxWaiting && total <= Redis::kMaxWaitingBytes;
  if (!fits) bytes = {};
  asio::post(io_, [this, fits, bytes = std::move(bytes), done = std::move(done), place]() mutable {
    if (hasEnded_) return;
    if (stage_ != Stage::kThere || !fits) return done({Answer::Kind::kUnsent, {}});
    commands_->send(std::move(bytes), [this, done = std::move(done), place](Answer answer) {
      const std::string error = answer.reply.isError() ? answer.reply.text : "";
      done(std::move(answer));
      // It is no master any more, or has lost what it was prepared with.
      if (beginsWithAny(error, {"READONLY", "LOADING", "MASTERDOWN", "CLUSTERDOWN", "NOSCRIPT", "NOAUTH"}))
        lost({"it answers '" + text::oneLine(error) + "'"});
    });
  });
}

// ---- subscriptions ----

Subscription Line::watch(const std::string& channel, std::string log, std::function<void(std::uint64_t)> changed) {
  return subscribe(channel, std::move(log), std::make_shared<Handler>(weak_from_this(), channel, std::move(changed), nullptr));
}
Subscription Line::hear(const std::string& channel, std::function<void(const std::string&)> heard) {
  return subscribe(channel, {}, std::make_shared<Handler>(weak_from_this(), channel, nullptr, std::move(heard)));
}

Subscription Line::subscribe(const std::string& channel, std::string log, std::shared_ptr<Handler> handler) {
  post([this, channel, log = std::move(log), weak = std::weak_ptr(handler)]() mutable {
    const auto [topic, isNew] = topics_.try_emplace(channel);
    topic->second.log = std::move(log);
    topic->second.handlers.push_back(std::move(weak));
    if (isNew && stage_ >= Stage::kSubscribing) return subscribeNow(channel);
    if (!isNew && stage_ == Stage::kThere && !topic->second.log.empty()) askLast(channel);
  });
  return handler;
}

void Line::subscribeNow(const std::string& channel) {
  if (stage_ == Stage::kSubscribing) return ask(*subscriptions_, {"SUBSCRIBE", channel}, [this](const Reply& reply) { isGood(reply); });
  subscriptions_->send(command({"SUBSCRIBE", channel}), [this, channel](const Answer& answer) {
    if (answer.kind != Answer::Kind::kReply || !isGood(answer.reply)) return;
    const auto topic = topics_.find(channel);
    if (stage_ == Stage::kThere && topic != topics_.end() && !topic->second.log.empty()) askLast(channel);
  });
}

void Line::askLast(const std::string& channel) {
  commands_->send(commandOf(Script::kLast, {topics_.at(channel).log}, {ownChannel_, channel}), [this](const Answer& answer) {
    if (answer.kind == Answer::Kind::kReply) isGood(answer.reply);
  });
}

void Line::tidy(const std::string& channel) {
  const auto topic = topics_.find(channel);
  if (topic == topics_.end()) return;
  std::erase_if(topic->second.handlers, [](const auto& weak) { return weak.expired(); });
  if (!topic->second.handlers.empty()) return;
  topics_.erase(topic);
  if (stage_ >= Stage::kSubscribing) subscriptions_->send(command({"UNSUBSCRIBE", channel}), [](const Answer&) {});
}

void Line::pushed(const Reply& reply) {
  std::string_view channel = reply.part(1), payload = reply.part(2);
  std::optional<std::uint64_t> last;
  if (channel == ownChannel_) {  // "LAST CHANNEL", as askLast() asked
    last = text::number<std::uint64_t>(text::takePart(payload, ' '));
    channel = payload;
  }
  const auto topic = topics_.find(std::string(channel));
  if (topic == topics_.end()) return;
  const auto each = [&](const auto& use) {
    for (const auto& weak : std::vector(topic->second.handlers))
      if (const auto handler = weak.lock()) use(*handler);
  };
  if (!topic->second.log.empty()) {
    if (!last) last = text::number<std::uint64_t>(payload);
    if (last) each([&](const Handler& handler) { handler.changed(*last); });
  } else if (payload.size() >= kServerBytes && payload.substr(0, kServerBytes) != senderOf(server_)) {
    const std::string message(payload.substr(kServerBytes));
    each([&](const Handler& handler) { handler.heard(message); });
  }
}

}  // namespace ridgecast::bus
