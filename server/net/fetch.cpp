#include "server/net/fetch.h"

#include <boost/asio/as_tuple.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <utility>

#include "common/text/text.h"
#include "common/transport/channel.h"
#include "server/net/server_context.h"

namespace ridgecast::net {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;
using boost::system::error_code;

constexpr auto kPair = asio::as_tuple(asio::use_awaitable);
constexpr std::chrono::milliseconds kLook{50};  // for a stop

std::string whereOf(const HttpsUrl& url) { return "https://" + url.host + ":" + url.port + url.target; }

// What went wrong; empty: nothing, and `body` is there.
asio::awaitable<std::string> getFile(const HttpsUrl& url, const std::string& authorities, std::size_t most, tcp::resolver& resolver,
                                     Channel& channel, std::string& body) {
  const auto [unknown, found] = co_await resolver.async_resolve(url.host, url.port, kPair);
  if (unknown) co_return "the host is not known (" + unknown.message() + ")";
  const auto [away, peer] = co_await asio::async_connect(channel.socket(), found, kPair);
  if (away) co_return "no connection (" + away.message() + ")";
  const auto insecure = co_await asio::async_initiate<const asio::use_awaitable_t<>, void(std::optional<std::string>)>(
      [&](auto handler) {
        channel.startTls(url.host, {authorities, "--jwt-key-ca"},
                         [own = std::make_shared<decltype(handler)>(std::move(handler))](std::optional<std::string> wrong) {
                           (*own)(std::move(wrong));
                         });
      },
      asio::use_awaitable);
  if (insecure) co_return *insecure;
  beast::http::request<beast::http::empty_body> request(beast::http::verb::get, url.target, 11);
  request.set(beast::http::field::host, url.port == "443" ? url.host : url.host + ":" + url.port);
  request.set(beast::http::field::user_agent, kServerName);
  request.set(beast::http::field::accept, "application/json");
  request.keep_alive(false);
  const auto [unsent, written] = co_await beast::http::async_write(channel, request, kPair);
  if (unsent) co_return "the connection was lost (" + unsent.message() + ")";
  beast::flat_buffer buffer;
  beast::http::response_parser<beast::http::string_body> parser;
  parser.body_limit(most);
  const auto [failed, read] = co_await beast::http::async_read(channel, buffer, parser, kPair);
  if (failed == beast::http::error::body_limit) co_return "it has more than " + std::to_string(most) + " bytes";
  if (failed) co_return "the answer is not whole (" + failed.message() + ")";
  if (parser.get().result_int() != 200) co_return "the answer is HTTP " + std::to_string(parser.get().result_int());
  body = std::move(parser.get().body());
  co_return "";
}

}  // namespace

Outcome<HttpsUrl> HttpsUrl::parse(std::string_view text) {
  const Error wrong{"'" + text::oneLine(text) + "' is not the URL of keys, such as https://issuer.example/keys.json."};
  constexpr std::string_view scheme = "https://";
  HttpsUrl out;
  if (!text.starts_with(scheme) || text.size() > 2000) return wrong;
  for (const char c : text)
    if (c <= ' ' || c >= 0x7f || c == '#' || c == '\\') return wrong;
  text.remove_prefix(scheme.size());
  const auto slash = text.find_first_of("/?");
  std::string_view authority = text.substr(0, slash);
  if (slash != text.npos) out.target = (text[slash] == '?' ? "/" : "") + std::string(text.substr(slash));
  if (authority.starts_with('[')) {
    const auto end = authority.find(']');
    if (end == authority.npos) return wrong;
    out.host = authority.substr(1, end - 1);
    authority.remove_prefix(end + 1);
  } else {
    const auto colon = std::min(authority.find(':'), authority.size());
    out.host = authority.substr(0, colon);
    authority.remove_prefix(colon);
  }
  if (!authority.empty()) {
    const auto port = text::number<std::uint16_t>(authority.substr(1));
    if (authority[0] != ':' || !port || *port == 0) return wrong;
    out.port = std::to_string(*port);
  }
  if (out.host.empty() || !text::hasOnly(out.host, ".-:")) return wrong;
  return out;
}

Outcome<std::string> fetch(const HttpsUrl& from, const std::filesystem::path& authorities, std::size_t most,
                           std::chrono::milliseconds timeout, const std::stop_token& stop) {
  asio::io_context io;
  tcp::resolver resolver(io);
  Channel channel{tcp::socket(io)};
  std::optional<std::string> wrong;
  std::string body;
  const std::string file = authorities.string();
  asio::co_spawn(io, getFile(from, file, most, resolver, channel, body),
                 [&](const std::exception_ptr& failure, std::string why) { wrong = failure ? "it failed" : std::move(why); });
  const auto end = std::chrono::steady_clock::now() + timeout;
  while (!wrong && !stop.stop_requested() && std::chrono::steady_clock::now() < end) io.run_one_for(kLook);
  if (!wrong) {
    wrong = stop.stop_requested() ? "given up" : "no answer within " + std::to_string(timeout.count() / 1000) + " s";
    resolver.cancel();
    channel.close();
    io.run_for(kLook);  // what was open ends
  }
  if (wrong->empty()) return Outcome<std::string>(boost::system::in_place_value, std::move(body));
  return Error{"Cannot fetch " + whereOf(from) + ": " + *wrong + "."};
}

}  // namespace ridgecast::net
