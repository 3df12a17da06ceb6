#include "client/connection/line.h"

#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ssl.hpp>
#include <string_view>

namespace ridgecast::connection {

namespace asio = boost::asio;
namespace ssl = asio::ssl;

namespace {

constexpr std::size_t kRecordBytes = 16'384;  // the most that a TLS record carries
constexpr std::size_t kMostHead = 8192;

}  // namespace

struct Line::Tls {
  explicit Tls(Socket& socket, ssl::context&& c) : context(std::move(c)), stream(socket, context) {}
  ssl::context context;
  ssl::stream<Socket&> stream;
  std::string record;  // being written
};

Line::Line(const executor_type& executor) : socket_(executor) {}
Line::~Line() = default;

void Line::startTls(const std::string& host, const std::string& ca, std::function<void(std::optional<std::string>)> done) {
  const auto fail = [&](std::string why) { asio::post(socket_.get_executor(), [done, why = std::move(why)] { done(why); }); };
  error_code ec;
  ssl::context context(ssl::context::tls_client);
  SSL_CTX_set_min_proto_version(context.native_handle(), TLS1_2_VERSION);
  if (ca.empty())
    context.set_default_verify_paths(ec);
  else
    context.load_verify_file(ca, ec);
  if (ec)
    return fail("the authorities in '" + ca + "' cannot be used (" + ec.message() + "); it must be a readable file of certificates in PEM");
  context.set_verify_mode(ssl::verify_peer, ec);
  tls_ = std::make_unique<Tls>(socket_, std::move(context));
  SSL* native = tls_->stream.native_handle();
  asio::ip::make_address(host, ec);
  if (ec) SSL_set_tlsext_host_name(native, host.c_str());
  tls_->stream.set_verify_callback(ssl::host_name_verification(host), ec);
  tls_->stream.async_handshake(ssl::stream_base::client, [this, host, ca, done](error_code failed) {
    if (!failed) return done(std::nullopt);
    if (failed == asio::error::operation_aborted) return;
    const long verdict = SSL_get_verify_result(tls_->stream.native_handle());
    if (verdict == X509_V_ERR_UNSPECIFIED)  // all that Asio's check of the name leaves
      return done("the server's certificate is not for '" + host + "'");
    if (verdict != X509_V_OK)
      return done(std::string("the server's certificate is not to be trusted: ") + X509_verify_cert_error_string(verdict) +
                  (ca.empty() ? "; name its authority with --ca FILE" : "; is '" + ca + "' its authority?"));
    done("no TLS could be agreed on (" + failed.message() + "); does the server speak it? Without it: ws://");
  });
}

// Takes whole interim answers off what was read; whether what is left is to be passed on.
bool Line::beginsAnswer() {
  static constexpr std::string_view kBegin = "HTTP/1.1 1", kUpgrade = "HTTP/1.1 101";
  for (;;) {
    const std::string_view text = head_;
    if (text.substr(0, kUpgrade.size()) == kUpgrade || text.substr(0, kBegin.size()) != kBegin.substr(0, text.size())) return true;
    const auto blank = text.find("\r\n\r\n");
    if (blank == std::string_view::npos || text.size() < kUpgrade.size()) return text.size() > kMostHead;
    head_.erase(0, blank + 4);
    interim_();
  }
}

void Line::readSome(const MutableBuffers& buffers, Done done) {
  if (interim_)
    return readBelow({asio::buffer(chunk_)}, Done([this, buffers, d = std::move(done)](error_code ec, std::size_t n) mutable {
                       head_.append(chunk_.data(), n);
                       if (ec || beginsAnswer()) interim_ = {};
                       if (ec && head_.empty()) return d(ec, 0);
                       readSome(buffers, std::move(d));
                     }));
  if (head_.empty()) return readBelow(buffers, std::move(done));
  const std::size_t copied = asio::buffer_copy(buffers, asio::buffer(head_));
  head_.erase(0, copied);
  asio::post(get_executor(), [d = std::move(done), copied]() mutable { d({}, copied); });
}

void Line::readBelow(const MutableBuffers& buffers, Done done) {
  if (!tls_) return socket_.async_read_some(buffers, [d = std::move(done)](error_code ec, std::size_t n) mutable { d(ec, n); });
  tls_->stream.async_read_some(buffers, [d = std::move(done)](error_code ec, std::size_t n) mutable {
    d(ec == ssl::error::stream_truncated ? error_code(asio::error::eof) : ec, n);
  });
}

void Line::writeSome(const ConstBuffers& buffers, Done done) {
  auto ended = [d = std::move(done)](error_code ec, std::size_t n) mutable { d(ec, n); };
  if (!tls_) return socket_.async_write_some(buffers, std::move(ended));
  // Each write is a record of its own: a frame's header and what follows go into one.
  tls_->record.resize(std::min(kRecordBytes, asio::buffer_size(buffers)));
  asio::buffer_copy(asio::buffer(tls_->record), buffers);
  tls_->stream.async_write_some(asio::buffer(tls_->record), std::move(ended));
}

}  // namespace ridgecast::connection
