#include "server/net/channel.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <optional>
#include <string>

namespace ridgecast::net {

namespace asio = boost::asio;
namespace ssl = asio::ssl;
using asio::ip::tcp;

namespace {

constexpr std::size_t kRecordBytes = 16'384;  // the most that a TLS record carries
constexpr unsigned char kHandshakeRecord = 22;
constexpr int kMostPassedOver = 64;  // reads of what comes after the end

}  // namespace

class TlsContext : public ssl::context {
 public:
  TlsContext() : ssl::context(ssl::context::tls_server) {}
};

Outcome<std::shared_ptr<TlsContext>> loadTls(const std::filesystem::path& certificate, const std::filesystem::path& key) {
  auto context = std::make_shared<TlsContext>();
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

  tcp::socket socket;
  asio::steady_timer deadline;
  std::shared_ptr<TlsContext> context;
  std::optional<ssl::stream<tcp::socket&>> tls;
  std::string record;  // under TLS: what is being written
  std::array<char, 1024> scratch{};
};

Channel::Channel(tcp::socket&& socket) : body_(std::make_shared<Body>(std::move(socket))) {}
Channel::Channel(Channel&&) noexcept = default;
Channel::~Channel() {
  if (body_) body_->close();
}

Channel::executor_type Channel::get_executor() const { return body_->socket.get_executor(); }

tcp::endpoint Channel::peer() const {
  error_code ignored;
  return body_->socket.remote_endpoint(ignored);
}

// What an operation needs lives in the body, which every handler here keeps: the channel may be gone when they run.

void Channel::startTls(std::shared_ptr<TlsContext> context, Done done) {
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

void Channel::readSome(const MutableBuffers& buffers, Done done) {
  auto ended = [body = body_, done = std::move(done)](error_code ec, std::size_t bytes) mutable {
    if (ec == ssl::error::stream_truncated) ec = asio::error::eof;  // many hang up without a word; messages and answers have lengths
    done(ec, bytes);
  };
  body_->tls ? body_->tls->async_read_some(buffers, std::move(ended)) : body_->socket.async_read_some(buffers, std::move(ended));
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
  body_->passOver(kMostPassedOver, std::move(done));
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

}  // namespace ridgecast::net
