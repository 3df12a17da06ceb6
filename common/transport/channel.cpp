#include "common/transport/channel.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <string_view>

#include "common/outcome/contract.h"

namespace ridgecast::transport {

namespace asio = boost::asio;
namespace ssl = asio::ssl;
using asio::ip::tcp;

namespace {

constexpr std::size_t kRecordBytes = 16'384;  // the most that a TLS record carries
constexpr unsigned char kHandshakeRecord = 22;
constexpr int kMaxPassedOver = 64;  // reads of what comes after the end
constexpr std::size_t kMaxHead = 8192;

}  // namespace

class TlsContext : public ssl::context {
 public:
  using ssl::context::context;
};

Outcome<std::shared_ptr<TlsContext>> loadTls(const std::filesystem::path& certificate, const std::filesystem::path& key) {
  auto context = std::make_shared<TlsContext>(ssl::context::tls_server);
  boost::system::error_code ec;
  SSL_CTX* native = context->native_handle();
  SSL_CTX_set_min_proto_version(native, TLS1_2_VERSION);
  SSL_CTX_set_options(native, SSL_OP_NO_RENEGOTIATION | SSL_OP_CIPHER_SERVER_PREFERENCE | SSL_OP_NO_COMPRESSION);
  SSL_CTX_set_mode(native, SSL_MODE_RELEASE_BUFFERS);
  // A key behind a password would be asked for on the terminal: it is none that a server can use.
  context->set_password_callback([](std::size_t, ssl::context::password_purpose) { return std::string(); }, ec);
  context->use_certificate_chain_file(certificate.string(), ec);
  if (ec)
    return Error{"Cannot use '" + certificate.string() + "' as certificate: " + ec.message() + "; it must be a readable chain in PEM."};
  const std::string strangers = "The key '" + key.string() + "' is not that of the certificate '" + certificate.string() + "'.";
  context->use_private_key_file(key.string(), ssl::context::pem, ec);
  if (ec && ERR_GET_REASON(static_cast<unsigned long>(ec.value())) == X509_R_KEY_VALUES_MISMATCH) return Error{strangers};
  if (ec)
    return Error{"Cannot use '" + key.string() + "' as key: " + ec.message() +
                 "; it must be the certificate's, in PEM, without a password."};
  if (SSL_CTX_check_private_key(native) != 1) {
    ERR_clear_error();
    return Error{strangers};
  }
  return context;
}

std::chrono::sys_seconds expiryOf(const TlsContext& context) {
  const X509* const certificate = SSL_CTX_get0_certificate(const_cast<TlsContext&>(context).native_handle());
  std::tm parts{};
  if (!certificate || ASN1_TIME_to_tm(X509_get0_notAfter(certificate), &parts) != 1) return {};
  return std::chrono::sys_seconds(std::chrono::seconds(timegm(&parts)));
}

struct Channel::Body : std::enable_shared_from_this<Channel::Body> {
  explicit Body(tcp::socket&& s) : socket(std::move(s)), deadline(socket.get_executor()) {}

  void close() {
    boost::system::error_code ignored;
    deadline.cancel();
    socket.close(ignored);
  }

  void passOver(int more, Done done) {
    socket.async_read_some(asio::buffer(scratch),
                           [self = shared_from_this(), more, done = std::move(done)](error_code ec, std::size_t) mutable {
                             if (ec || more == 0) return done(ec == asio::error::eof ? error_code() : ec, 0);
                             self->passOver(more - 1, std::move(done));
                           });
  }

  void read(const MutableBuffers& buffers, Done done) {
    auto ended = [self = shared_from_this(), done = std::move(done)](error_code ec, std::size_t bytes) mutable {
      if (ec == ssl::error::stream_truncated) ec = asio::error::eof;  // many hang up without a word; messages and answers have lengths
      done(ec, bytes);
    };
    tls ? tls->async_read_some(buffers, std::move(ended)) : socket.async_read_some(buffers, std::move(ended));
  }

  // An answer's head, but for the interim ones before it; then what was read of it.
  void readHead(const MutableBuffers& buffers, Done done) {
    if (interim)
      return read({asio::buffer(scratch)},
                  Done([self = shared_from_this(), buffers, done = std::move(done)](error_code ec, std::size_t bytes) mutable {
                    self->head.append(self->scratch.data(), bytes);
                    if (ec || self->beginsAnswer()) self->interim = {};
                    if (ec && self->head.empty()) return done(ec, 0);
                    self->readHead(buffers, std::move(done));
                  }));
    const std::size_t copied = asio::buffer_copy(buffers, asio::buffer(head));
    head.erase(0, copied);
    asio::post(socket.get_executor(), [done = std::move(done), copied]() mutable { done({}, copied); });
  }

  // Takes whole interim answers off what was read; whether what is left is to be passed on.
  bool beginsAnswer() {
    static constexpr std::string_view kBegin = "HTTP/1.1 1", kUpgrade = "HTTP/1.1 101";
    for (;;) {
      const std::string_view text = head;
      if (text.substr(0, kUpgrade.size()) == kUpgrade || text.substr(0, kBegin.size()) != kBegin.substr(0, text.size())) return true;
      const auto blank = text.find("\r\n\r\n");
      if (blank == std::string_view::npos || text.size() < kUpgrade.size()) return text.size() > kMaxHead;
      head.erase(0, blank + 4);
      interim();
    }
  }

  tcp::socket socket;
  asio::steady_timer deadline;
  std::shared_ptr<TlsContext> context;
  std::optional<ssl::stream<tcp::socket&>> tls;
  std::string record;  // under TLS: what is being written
  std::array<char, 1024> scratch{};
  std::function<void()> interim;  // set: the answer has not begun
  std::string head;               // what was read of it, and nobody has had yet
};

Channel::Channel(tcp::socket&& socket) : body_(std::make_shared<Body>(std::move(socket))) {}
Channel::Channel(Channel&&) noexcept = default;
Channel::~Channel() {
  if (body_) body_->close();
}

Channel::executor_type Channel::get_executor() const { return body_->socket.get_executor(); }

tcp::socket& Channel::socket() { return body_->socket; }

// What an operation needs lives in the body, which every handler here keeps: the channel may be gone when they run.

void Channel::startTls(std::shared_ptr<TlsContext> context, Done done) {
  expects(context && !body_->tls, "TLS begins once, with a certificate");
  body_->socket.async_wait(tcp::socket::wait_read, [body = body_, context = std::move(context),
                                                    done = std::move(done)](error_code ec) mutable {
    unsigned char first = 0;
    std::size_t bytes = 0;
    if (!ec) bytes = body->socket.receive(asio::buffer(&first, 1), tcp::socket::message_peek, ec);
    if (!ec && bytes == 0) ec = asio::error::eof;
    if (!ec && first != kHandshakeRecord) ec = asio::error::no_protocol_option;
    if (ec) return done(ec, 0);
    body->context = std::move(context);
    body->tls.emplace(body->socket, *body->context);
    body->tls->async_handshake(ssl::stream_base::server, [body, done = std::move(done)](error_code failed) mutable { done(failed, 0); });
  });
}

void Channel::startTls(const std::string& host, const Authorities& authorities, std::function<void(std::optional<std::string>)> done) {
  expects(!body_->tls, "TLS begins once");
  error_code ec;
  const std::string& ca = authorities.file;
  auto context = std::make_shared<TlsContext>(ssl::context::tls_client);
  SSL_CTX_set_min_proto_version(context->native_handle(), TLS1_2_VERSION);
  ca.empty() ? context->set_default_verify_paths(ec) : context->load_verify_file(ca, ec);
  if (ec)
    return asio::post(get_executor(), [done, ca, ec] {
      done("the authorities in '" + ca + "' cannot be used (" + ec.message() + "); it must be a readable file of certificates in PEM");
    });
  context->set_verify_mode(ssl::verify_peer, ec);
  body_->context = std::move(context);
  ssl::stream<tcp::socket&>& tls = body_->tls.emplace(body_->socket, *body_->context);
  SSL* const native = tls.native_handle();
  asio::ip::make_address(host, ec);
  if (ec) SSL_set_tlsext_host_name(native, host.c_str());
  tls.set_verify_callback(ssl::host_name_verification(host), ec);
  tls.async_handshake(ssl::stream_base::client, [body = body_, native, host, authorities, done = std::move(done)](error_code failed) {
    if (!failed) return done(std::nullopt);
    if (failed == asio::error::operation_aborted) return;
    const long verdict = SSL_get_verify_result(native);
    if (verdict == X509_V_ERR_UNSPECIFIED)  // all that Asio's check of the name leaves
      return done("the server's certificate is not for '" + host + "'");
    if (verdict != X509_V_OK)
      return done(std::string("the server's certificate is not to be trusted: ") + X509_verify_cert_error_string(verdict) +
                  (authorities.file.empty() ? std::string("; name its authority with ") + authorities.flag + " FILE"
                                            : "; is '" + authorities.file + "' its authority?"));
    done("no TLS could be agreed on (" + failed.message() + "); does the server speak it? Without it: " + authorities.withoutTls);
  });
}

void Channel::passOverInterim(std::function<void()> tell) {
  expects(tell && body_->head.empty(), "interim responses are passed over before anything is read, and told of");
  body_->interim = std::move(tell);
}

void Channel::readSome(const MutableBuffers& buffers, Done done) {
  body_->interim || !body_->head.empty() ? body_->readHead(buffers, std::move(done)) : body_->read(buffers, std::move(done));
}

void Channel::writeSome(const ConstBuffers& buffers, Done done) {
  auto ended = [body = body_, done = std::move(done)](error_code ec, std::size_t bytes) mutable { done(ec, bytes); };
  if (!body_->tls) return body_->socket.async_write_some(buffers, std::move(ended));
  // Each write is a record of its own: a frame's header and what follows go into one.
  body_->record.resize(std::min(kRecordBytes, asio::buffer_size(buffers)));
  asio::buffer_copy(asio::buffer(body_->record), buffers);
  body_->tls->async_write_some(asio::buffer(body_->record), std::move(ended));
}

void Channel::finish(Done done) {
  if (body_->tls)
    return body_->tls->async_shutdown([body = body_, done = std::move(done)](error_code ec) mutable {
      done(ec == asio::error::eof || ec == ssl::error::stream_truncated ? error_code() : ec, 0);
    });
  error_code ignored;
  body_->socket.shutdown(tcp::socket::shutdown_send, ignored);
  body_->passOver(kMaxPassedOver, std::move(done));
}

void Channel::expires_at(Clock::time_point when) {
  body_->deadline.expires_at(when);
  body_->deadline.async_wait([weak = std::weak_ptr(body_)](error_code ec) {
    if (ec) return;
    const auto body = weak.lock();
    if (body && body->deadline.expiry() <= Clock::now()) body->close();
  });
}

void Channel::expires_never() { body_->deadline.expires_at(Clock::time_point::max()); }

void Channel::cancel() {
  error_code ignored;
  body_->socket.cancel(ignored);
}

void Channel::close() { body_->close(); }

}  // namespace ridgecast::transport
