#include "server/bus/redis.h"

#include <algorithm>
#include <array>
#include <utility>

#include "common/text/file.h"
#include "common/text/text.h"
#include "server/bus/line.h"

namespace ridgecast::bus {

namespace {

using Script = Line::Script;
using Kind = Appended::Kind;

constexpr std::size_t kMaxReadBytes = std::size_t{8} << 20, kMaxReadEntries = 4096;  // by one read()
constexpr std::size_t kMaxPasswordBytes = 4096;

const std::vector<double> kAppendSeconds{0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2};

// By Appended::Kind.
constexpr std::array<const char*, 5> kAppendResults{"done", "refused", "away", "full", "unknown"};

constexpr std::string_view kRecords = "ridgecast:records";
constexpr std::size_t kSmallRecord = std::size_t{64} << 10;
constexpr const char* kNearlyFull = "less than a sixteenth of its memory is left, which is for small records";
constexpr const char* kOdd = "The engine between the servers answers as nobody asked it to.";
constexpr const char* kAway = "The engine between the servers cannot be reached, or too much waits for it; try again soon.";

std::string recordKey(const std::string& key) { return "ridgecast:record:" + key; }
std::string epochKey(const std::string& key) { return "ridgecast:epoch:" + key; }
std::string logKey(const std::string& log) { return "ridgecast:log:" + log; }

// The first text after all that begin so, for ZRANGEBYLEX.
std::string endOf(std::string prefix) {
  while (!prefix.empty() && prefix.back() == '\xff') prefix.pop_back();
  if (prefix.empty()) return "+";
  ++prefix.back();
  return "(" + prefix;
}

std::optional<std::uint64_t> numberOf(std::string_view text) { return text::number<std::uint64_t>(text); }

// Why a call that asks for something has none; nothing: it has a reply.
std::optional<Error> failureOf(const Line::Answer& answer) {
  if (answer.kind != Line::Answer::Kind::kReply) return Error{kAway};
  if (answer.reply.isError()) return Error{"The engine between the servers answers '" + text::oneLine(answer.reply.text) + "'."};
  return std::nullopt;
}

Appended appendedOf(const Line::Answer& answer) {
  using Answered = Line::Answer::Kind;
  if (answer.kind == Answered::kUnsent) return {Kind::kAway, 0, kAway};
  if (answer.kind == Answered::kLost) return {Kind::kUnknown};
  const Reply& reply = answer.reply;
  if (reply.isError()) return {Kind::kAway, 0, failureOf(answer)->message};
  const std::string_view word = reply.part(0);
  if (reply.parts.size() != 3 || reply.parts[1].kind != Reply::Kind::kInteger || reply.parts[1].integer < 0) return {Kind::kUnknown};
  const auto last = static_cast<std::uint64_t>(reply.parts[1].integer);
  if (word == "done") return {Kind::kDone, last};
  if (word == "behind") return {Kind::kBehind, last};
  if (word == "grace") return {Kind::kAway, 0, "The engine between the servers has just come back; it takes new entries soon."};
  if (word == "full") return {Kind::kFull, last, "The engine between the servers has no room ('" + text::oneLine(reply.part(2)) + "')."};
  return {Kind::kUnknown};
}

Outcome<Address> addressOf(const Redis::Settings& settings) {
  auto address = parseAddress(settings.url);
  if (!address) return address;
  if (settings.passwordFile.empty()) {
    if (!address->user.empty() && address->password.empty())
      return Error{"The engine's URL names a user; give its password there or in --shared-password-file."};
    return address;
  }
  const auto text = text::readFile(settings.passwordFile, kMaxPasswordBytes);
  std::string_view rest = text ? std::string_view(*text) : std::string_view();
  const std::string_view password = text::trimmed(text::takePart(rest, '\n'));
  if (password.empty() || text->size() > kMaxPasswordBytes)
    return Error{"The file '" + settings.passwordFile.string() + "' must be readable and hold the engine's password, alone."};
  if (!address->password.empty()) return Error{"The engine's password is in its URL and in a file; leave one of them out."};
  address->password = password;
  return address;
}

Outcome<Bus::Held> heldOf(const Line::Answer& answer) {
  if (const auto error = failureOf(answer)) return *error;
  const Reply& reply = answer.reply;
  const auto stands = numberOf(reply.part(1));
  if (reply.parts.size() != 3 || !stands) return Error{kOdd};
  return Bus::Held{reply.parts[0].integer == 1, {std::string(reply.part(2)), *stands}};
}

}  // namespace

// Counts what is called, by what became of it.
struct Redis::Figures {
  explicit Figures(std::shared_ptr<metrics::Metrics> all)
      : metrics(std::move(all)),
        appendSeconds(metrics->registry.histogram("ridgecast_bus_append_seconds",
                                                  "How long appends to the engine of --shared took, until it answered.", kAppendSeconds)) {
    for (const char* result : kAppendResults) calls("append", result);  // an alert must see the first
  }

  metrics::Counter& calls(const char* call, const char* result) {
    return metrics->registry.counter("ridgecast_bus_calls_total", "Calls to the engine of --shared.", {{"call", call}, {"result", result}});
  }
  void count(const char* call, const char* result) { calls(call, result).Increment(); }
  template <class T>
  void count(const char* call, const Outcome<T>& outcome) {
    count(call, outcome ? "done" : "failed");
  }

  const std::shared_ptr<metrics::Metrics> metrics;
  metrics::Histogram& appendSeconds;
};

Outcome<std::shared_ptr<Redis>> Redis::connect(const Settings& settings, std::shared_ptr<metrics::Metrics> figures) {
  auto address = addressOf(settings);
  if (!address) return address.error();
  const auto line = std::make_shared<Line>(std::move(*address), settings.ca.string(), *figures);
  if (const auto error = line->start()) return *error;
  return std::shared_ptr<Redis>(new Redis(line, std::make_shared<Figures>(std::move(figures))));
}

Redis::Redis(std::shared_ptr<Line> line, std::shared_ptr<Figures> figures) : line_(std::move(line)), figures_(std::move(figures)) {}
Redis::~Redis() { end(); }
void Redis::end() { line_->stop(); }

std::string Redis::where() const { return line_->where(); }
std::uint32_t Redis::server() const { return line_->server(); }
bool Redis::isAway() const { return line_->isAway(); }
std::int64_t Redis::now() const { return line_->now(); }

// ---- logs ----

void Redis::append(const std::string& log, std::uint64_t after, std::vector<std::string> entries, Origin origin,
                   std::function<void(Appended)> done) {
  std::size_t bytes = 0;
  for (const std::string& entry : entries) bytes += entry.size() + 32;
  auto answered = [f = figures_, done = std::move(done), begun = std::chrono::steady_clock::now()](const Line::Answer& answer) {
    Appended appended = appendedOf(answer);
    f->count("append", kAppendResults[static_cast<std::size_t>(appended.kind)]);
    if (answer.kind == Line::Answer::Kind::kReply)
      f->appendSeconds.Observe(std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
    done(std::move(appended));
  };
  const char* refused = nullptr;
  if (origin == Origin::kNew && line_->isNearlyFull()) refused = kNearlyFull;
  if (bytes > kMaxAppendBytes) refused = "an append has at most 16 MiB";
  if (refused) entries.clear();
  const std::string number = std::to_string(after), topic = line_->channelOf("log", log), key = logKey(log);
  std::vector<std::string_view> arguments{topic, number, origin == Origin::kNew ? "new" : "kept"};
  arguments.insert(arguments.end(), entries.begin(), entries.end());
  if (!refused) {
    line_->countWritten(bytes);
    return line_->call(Script::kAppend, {key, "ridgecast:grace"}, arguments, std::move(answered));
  }
  // Its last number is read by appending nothing.
  line_->call(Script::kAppend, {key, "ridgecast:grace"}, arguments, [answered = std::move(answered), refused](Line::Answer answer) {
    if (answer.reply.part(0) == "done") {
      answer.reply.parts[0].text = "full";
      answer.reply.parts[2].text = refused;
    }
    answered(answer);
  });
}

void Redis::read(const std::string& log, std::uint64_t after, std::size_t most, std::function<void(Outcome<std::vector<Entry>>)> done) {
  const std::string number = std::to_string(after), bytes = std::to_string(std::min(most, kMaxReadBytes)),
                    entries = std::to_string(kMaxReadEntries);
  line_->call(Script::kRead, {logKey(log)}, {number, bytes, entries}, [f = figures_, after, done = std::move(done)](Line::Answer answer) {
    Outcome<std::vector<Entry>> out = std::vector<Entry>();
    if (const auto error = failureOf(answer)) out = *error;
    std::uint64_t next = after;
    if (out)
      for (Reply& part : answer.reply.parts) out->push_back({++next, std::move(part.text)});
    f->count("read", out);
    done(std::move(out));
  });
}

Subscription Redis::watch(const std::string& log, std::function<void(std::uint64_t last)> changed) {
  return line_->watch(line_->channelOf("log", log), logKey(log), std::move(changed));
}

// ---- messages ----

void Redis::tell(const std::string& name, std::string message) {
  line_->publish(line_->channelOf("channel", name), message,
                 [f = figures_](const Line::Answer& answer) { f->count("tell", failureOf(answer) ? "failed" : "done"); });
}

Subscription Redis::hear(const std::string& name, std::function<void(const std::string& message)> heard) {
  return line_->hear(line_->channelOf("channel", name), std::move(heard));
}

// ---- records ----

void Redis::hold(const std::string& key, std::string value, std::uint64_t epoch, std::chrono::milliseconds life,
                 std::function<void(Outcome<Held>)> done) {
  auto answered = [f = figures_, done = std::move(done)](Outcome<Held> held) {
    f->count("hold", !held ? "failed" : held->isYours ? "done" : "refused");
    done(std::move(held));
  };
  if (value.size() > kMaxValueBytes)
    return line_->post([answered = std::move(answered)] { answered(Error{"A record has at most 4 MiB."}); });
  if (value.size() > kSmallRecord && line_->isNearlyFull())
    return line_->post(
        [answered = std::move(answered)] { answered(Error{std::string("Of the engine between the servers ") + kNearlyFull + "."}); });
  const std::string number = std::to_string(epoch), milliseconds = std::to_string(life.count()), record = recordKey(key),
                    last = epochKey(key);
  line_->call(Script::kHold, {record, last, kRecords, "ridgecast:era"}, {key, value, number, milliseconds},
              [answered = std::move(answered), value](const Line::Answer& answer) mutable {
                auto held = heldOf(answer);
                if (held && held->isYours) held->record.value = std::move(value);
                answered(std::move(held));
              });
}

void Redis::take(const std::string& key, std::uint64_t epoch, std::function<void(Outcome<Held>)> done) {
  const std::string number = std::to_string(epoch);
  line_->call(Script::kTake, {recordKey(key), epochKey(key), "ridgecast:era"}, {number},
              [f = figures_, done = std::move(done)](const Line::Answer& answer) {
                auto held = heldOf(answer);
                f->count("take", !held ? "failed" : held->isYours ? "done" : "refused");
                done(std::move(held));
              });
}

void Redis::drop(const std::string& key, std::uint64_t epoch) {
  const std::string number = std::to_string(epoch), record = recordKey(key), last = epochKey(key);
  line_->call(Script::kDrop, {record, last, kRecords}, {key, number},
              [f = figures_](const Line::Answer& answer) { f->count("drop", failureOf(answer) ? "failed" : "done"); });
}

// Page by page.
struct Redis::Listing : std::enable_shared_from_this<Listing> {
  std::shared_ptr<Line> line;
  std::string to;
  std::size_t bytes = 0;
  std::map<std::string, Record> found{};
  std::function<void(Outcome<std::map<std::string, Record>>)> done;

  void go(const std::string& from) {
    line->call(Script::kList, {kRecords}, {from, to, recordKey("")},
               [self = shared_from_this()](const Line::Answer& answer) { self->take(answer); });
  }
  void take(const Line::Answer& answer) {
    if (auto error = failureOf(answer)) return done(std::move(*error));
    const Reply& reply = answer.reply;
    if (reply.parts.size() % 3 != 1) return done(Error{kOdd});
    for (std::size_t i = 1; i < reply.parts.size(); i += 3) {
      const std::string_view key = reply.part(i), value = reply.part(i + 2);
      const auto epoch = numberOf(reply.part(i + 1));
      if (!epoch) return done(Error{kOdd});
      bytes += key.size() + value.size();
      found[std::string(key)] = {std::string(value), *epoch};
    }
    if (reply.part(0).empty()) return done(std::move(found));
    if (bytes > kMaxListedBytes) return done(Error{"More than 64 MiB of records are there."});
    go(std::string(reply.part(0)));
  }
};

void Redis::list(const std::string& prefix, std::function<void(Outcome<std::map<std::string, Record>>)> done) {
  const auto listing = std::make_shared<Listing>();
  listing->line = line_;
  listing->to = endOf(prefix);
  listing->done = [f = figures_, done = std::move(done)](Outcome<std::map<std::string, Record>> found) {
    f->count("list", found);
    done(std::move(found));
  };
  listing->go("[" + prefix);
}

}  // namespace ridgecast::bus
