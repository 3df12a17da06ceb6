#include "client/link/download.h"

#include <strings.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/write.hpp>
#include <charconv>
#include <fstream>
#include <optional>
#include <system_error>
#include <utility>

#include "client/link/dial.h"
#include "common/outcome/contract.h"

namespace ridgecast::link {

namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;
using error_code = boost::system::error_code;

constexpr std::size_t kMaxHeader = 65'536, kMaxSentence = 4096;
constexpr std::chrono::milliseconds kTellEvery{100};

// Fit for a terminal.
std::string printable(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c < ' ' || c == 0x7f) c = c == '\n' || c == '\r' ? ' ' : '?';
  return out;
}

std::string sentenceOf(std::string_view text) {
  std::string out = printable(text);
  while (out.ends_with(' ')) out.pop_back();
  return out;
}

// What there is to know of an answer's header.
struct Header {
  int status = 0;
  std::optional<std::uint64_t> length;
  std::string retryAfter, progress;
};

std::optional<Header> parse(std::string_view text) {
  Header out;
  if (!text.starts_with("HTTP/1.") || text.size() < 12) return std::nullopt;
  if (std::from_chars(text.data() + 9, text.data() + 12, out.status).ptr != text.data() + 12) return std::nullopt;
  for (auto at = text.find("\r\n"); at != std::string_view::npos;) {
    const auto next = text.find("\r\n", at + 2);
    const std::string_view line = text.substr(at + 2, next == std::string_view::npos ? std::string_view::npos : next - at - 2);
    at = next;
    const auto colon = line.find(':');
    if (colon == std::string_view::npos) continue;
    const auto is = [&](std::string_view name) { return colon == name.size() && strncasecmp(line.data(), name.data(), colon) == 0; };
    std::string_view value = line.substr(colon + 1);
    while (value.starts_with(' ')) value.remove_prefix(1);
    if (is("Content-Length")) {
      std::uint64_t n = 0;
      const auto [stopped, failed] = std::from_chars(value.data(), value.data() + value.size(), n);
      if (failed != std::errc() || stopped != value.data() + value.size()) return std::nullopt;
      out.length = n;
    } else if (is("Retry-After")) {
      out.retryAfter = value.substr(0, 20);
    } else if (is("Progress")) {
      out.progress = printable(value.substr(0, 80));
    }
  }
  return out;
}

class Download {
 public:
  // Takes the body's bytes; what is wrong with that, if anything.
  using Take = std::function<std::optional<std::string>(std::string_view)>;

  Download(const core::Url& url, std::chrono::milliseconds timeout, Take take, const std::function<void(const Progress&)>& tell,
           std::stop_token stop)
      : url_(url), timeout_(timeout), take_(std::move(take)), tell_(tell), stop_(std::move(stop)) {}

  // The number of bytes. Error: also an answer of another status than 200, which status() and sentence() then have.
  Outcome<std::uint64_t> run(const std::string& method, const std::string& target) {
    expects(request_.empty(), "a download is run once");
    request_ = method + " " + target + " HTTP/1.1\r\nHost: " + where_ +
               "\r\nUser-Agent: ridgecast-client\r\nAccept: */*\r\nPrefer: progress\r\nConnection: close\r\n" +
               (url_.token.empty() ? "" : "Authorization: Bearer " + url_.token + "\r\n") + "\r\n";
    dial(url_, resolver_, channel_, step_, [this](std::optional<std::string> wrong) {
      if (!ended()) wrong ? end(std::move(*wrong)) : ask();
    });
    while (!ended()) {
      context_.run_one_for(kTellEvery);
      context_.poll();
      if (Clock::now() - told_ >= kTellEvery) report();
      if (!ended() && Clock::now() - lastWord_ > timeout_)
        end(header_ ? "the server stopped sending"
                    : "no answer from " + where_ + " within " + std::to_string(timeout_.count() / 1000) + " s");
      if (!ended() && stop_.stop_requested()) end("given up");
      if (context_.stopped()) context_.restart();
    }
    channel_.close();
    if (error_) return *error_;
    report();
    return progress_.received;
  }
  bool ended() const { return isWhole_ || error_; }
  int status() const { return isWhole_ ? header_->status : 0; }  // 0: no whole answer has come
  std::string sentence() const { return sentenceOf(text_); }

 private:
  void report() {
    told_ = Clock::now();
    progress_.waited = std::chrono::duration_cast<std::chrono::milliseconds>(told_ - begun_);
    progress_.total = header_ ? header_->length.value_or(0) : 0;
    if (tell_) tell_(progress_);
  }
  void end(std::string why) { error_ = Error{std::move(why)}; }

  void ask() {
    asio::async_write(channel_, asio::buffer(request_), [this](error_code ec, std::size_t) {
      if (ec) return end("the connection to " + where_ + " was lost: " + ec.message());
      read();
    });
  }

  void read() {
    channel_.async_read_some(asio::buffer(buffer_), [this](error_code ec, std::size_t bytes) {
      if (ended()) return;
      lastWord_ = Clock::now();
      take({buffer_.data(), bytes});
      if (ended()) return;
      if (!ec) return read();
      if (header_ && !header_->length && ec == asio::error::eof) return complete();
      end("the connection to " + where_ + " was lost before all had come: " + ec.message());
    });
  }

  void take(std::string_view bytes) {
    std::string rest;
    if (!header_) text_ += bytes;
    while (!header_) {
      const auto blank = text_.find("\r\n\r\n");
      if (blank == std::string::npos) {
        if (text_.size() > kMaxHeader) end("what answers at " + where_ + " is not a Ridgecast server; check host and port");
        return;
      }
      header_ = parse(std::string_view(text_).substr(0, blank));
      if (!header_) return end("what answers at " + where_ + " is not a Ridgecast server; check host and port");
      text_.erase(0, blank + 4);
      if (header_->status / 100 == 1) {  // word of the work; the answer itself follows
        progress_.work = header_->progress;
        header_.reset();
        continue;
      }
      rest = std::exchange(text_, {});
      bytes = rest;
      if (header_->length && *header_->length == 0) return complete();
      if (bytes.empty()) return;
    }
    progress_.received += bytes.size();
    if (header_->status != 200)
      text_ += bytes.substr(0, kMaxSentence - std::min(kMaxSentence, text_.size()));
    else if (auto wrong = take_(bytes))
      return end(std::move(*wrong));
    if (header_->length && progress_.received >= *header_->length) complete();
  }

  void complete() {
    expects(header_ && !ended(), "an answer has a header, and is complete once");
    isWhole_ = true;
    if (header_->status == 200) return;
    const std::string later = header_->retryAfter.empty() ? "" : " (try again in " + header_->retryAfter + " s)";
    end("the server at " + where_ + " says: " + (sentence().empty() ? "HTTP " + std::to_string(header_->status) : sentence()) + later);
  }

  const core::Url& url_;
  const std::string where_ = url_.where();
  const std::chrono::milliseconds timeout_;
  const Take take_;
  const std::function<void(const Progress&)>& tell_;
  const std::stop_token stop_;
  asio::io_context context_;
  asio::ip::tcp::resolver resolver_{context_};
  transport::Channel channel_{asio::ip::tcp::socket(context_)};
  Dialing step_ = Dialing::kResolving;
  std::string request_, text_;  // what was read of the header, then of a refusal's sentence
  std::array<char, 65'536> buffer_;
  std::optional<Header> header_;
  Progress progress_;
  const Clock::time_point begun_ = Clock::now();
  Clock::time_point lastWord_ = begun_, told_{};
  bool isWhole_ = false;
  std::optional<Error> error_;
};

// A file that is there whole or not at all.
class WholeFile {
 public:
  explicit WholeFile(const std::filesystem::path& file)
      : file_(file),
        unfinished_(file.string() + "." + std::to_string(getpid()) + ".part"),
        out_(unfinished_, std::ios::binary | std::ios::trunc) {}
  ~WholeFile() {
    std::error_code ignored;
    std::filesystem::remove(unfinished_, ignored);
  }
  WholeFile(const WholeFile&) = delete;
  bool good() const { return static_cast<bool>(out_); }
  std::string problem() const { return "cannot write " + file_.string() + ": choose a folder that exists, may be written and has room"; }
  void write(std::string_view bytes) { out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size())); }
  bool finish() {
    out_.close();
    std::error_code failed;
    if (out_) std::filesystem::rename(unfinished_, file_, failed);
    return out_ && !failed;
  }

 private:
  const std::filesystem::path file_, unfinished_;
  std::ofstream out_;
};

}  // namespace

Outcome<std::uint64_t> download(const core::Url& url, const std::string& target, const std::filesystem::path& file,
                                std::chrono::milliseconds timeout, const std::function<void(const Progress&)>& tell) {
  WholeFile out(file);
  if (!out.good()) return Error{out.problem()};
  const auto take = [&out](std::string_view bytes) {
    out.write(bytes);
    return out.good() ? std::nullopt : std::optional(out.problem());
  };
  auto bytes = Download(url, timeout, take, tell, {}).run("GET", target);
  if (bytes && !out.finish()) return Error{out.problem()};
  return bytes;
}

Outcome<std::string> fetch(const core::Url& url, const std::string& target, std::size_t most, std::chrono::milliseconds timeout,
                           std::stop_token stop) {
  std::string text;
  const auto take = [&](std::string_view bytes) -> std::optional<std::string> {
    text += bytes.substr(0, most + 1 - text.size());
    return text.size() > most ? std::optional("the server's answer to " + target + " is larger than " + std::to_string(most) + " bytes")
                              : std::nullopt;
  };
  auto bytes = Download(url, timeout, take, {}, std::move(stop)).run("GET", target);
  if (!bytes) return bytes.error();
  return Outcome<std::string>(boost::system::in_place_value, std::move(text));
}

Outcome<HttpAnswer> request(const core::Url& url, const std::string& method, const std::string& target, std::chrono::milliseconds timeout,
                            std::stop_token stop) {
  std::string text;
  const auto take = [&](std::string_view bytes) -> std::optional<std::string> {
    text += bytes.substr(0, kMaxSentence - text.size());
    return std::nullopt;
  };
  const std::function<void(const Progress&)> tell;
  Download one(url, timeout, take, tell, std::move(stop));
  auto bytes = one.run(method, target);
  if (!bytes && one.status() == 0) return bytes.error();
  return HttpAnswer{one.status(), bytes ? sentenceOf(text) : one.sentence()};
}

}  // namespace ridgecast::link
