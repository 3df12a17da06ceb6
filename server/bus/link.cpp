#include "server/bus/link.h"

#include <boost/asio/buffer.hpp>
#include <boost/asio/connect.hpp>
#include <boost/asio/write.hpp>
#include <utility>

#include "common/outcome/contract.h"
#include "common/text/text.h"

namespace ridgecast::bus {

namespace asio = boost::asio;

Link::Link(asio::io_context& io, Address address, std::string ca, Events events)
    : address_(std::move(address)), ca_(std::move(ca)), events_(std::move(events)), resolver_(io), socket_(io) {}

void Link::open() {
  progress_ = Clock::now();
  resolver_.async_resolve(address_.host, std::to_string(address_.port), [self = shared_from_this()](error_code ec, const auto& places) {
    if (self->hasEnded_) return;
    if (ec) return self->end({"the name '" + self->address_.host + "' is unknown (" + ec.message() + ")"});
    self->connect(places);
  });
}

void Link::connect(const asio::ip::tcp::resolver::results_type& places) {
  asio::async_connect(socket_, places, [self = shared_from_this()](error_code ec, const auto&) {
    if (self->hasEnded_) return;
    if (ec) return self->end({"it cannot be reached (" + ec.message() + ")"});
    self->socket_.set_option(asio::ip::tcp::no_delay(true), ec);
    self->channel_.emplace(std::move(self->socket_));
    self->address_.tls ? self->secure() : self->greet();
  });
}

void Link::secure() {
  channel_->startTls(address_.host, {ca_, "--shared-ca", "redis://"}, [self = shared_from_this()](const std::optional<std::string>& wrong) {
    if (self->hasEnded_) return;
    wrong ? self->end({*wrong, true}) : self->greet();
  });
}

void Link::greet() {
  isOpen_ = true;
  read();
  const auto expectOk = [this](const char* what, bool isLast) {
    return [self = shared_from_this(), what, isLast](const Answer& answer) {
      if (answer.kind != Answer::Kind::kReply) return;
      if (answer.reply.isError()) return self->end({"it " + std::string(what) + " (" + text::oneLine(answer.reply.text) + ")", true});
      if (isLast) self->events_.opened();
    };
  };
  if (!address_.password.empty()) {
    const auto auth = address_.user.empty() ? command({"AUTH", address_.password}) : command({"AUTH", address_.user, address_.password});
    send(auth, expectOk("refuses the user or the password", false));
  }
  send(command({"SELECT", std::to_string(address_.database)}), expectOk("refuses its database; a password may be missing", true));
}

void Link::send(std::string bytes, Done done) {
  expects(isOpen_ && !hasEnded_, "commands are sent while the connection is open");
  if (calls_.empty()) progress_ = Clock::now();
  calls_.push_back(std::move(done));
  ++unsent_;
  waiting_.empty() ? waiting_ = std::move(bytes) : waiting_ += bytes;
  write();
}

void Link::write() {
  if (!writing_.empty() || waiting_.empty() || hasEnded_) return;
  writing_ = std::exchange(waiting_, {});
  unsent_ = 0;
  asio::async_write(*channel_, asio::buffer(writing_), [self = shared_from_this()](error_code ec, std::size_t) {
    if (self->hasEnded_) return;
    if (ec) return self->end({"it has closed the connection (" + ec.message() + ")"});
    self->writing_ = {};
    self->write();
  });
}

void Link::read() {
  channel_->async_read_some(asio::buffer(buffer_), [self = shared_from_this()](error_code ec, std::size_t bytes) {
    if (self->hasEnded_) return;
    if (ec) return self->end({"it has closed the connection (" + ec.message() + ")"});
    self->received(bytes);
    if (!self->hasEnded_) self->read();
  });
}

void Link::received(std::size_t bytes) {
  progress_ = Clock::now();
  reader_.feed({buffer_.data(), bytes});
  while (!hasEnded_) {
    auto next = reader_.next();
    if (!next) return end({next.error().message});
    if (!*next) return;
    Reply& reply = **next;
    if (events_.pushed && reply.part(0) == "message") {
      events_.pushed(reply);
      continue;
    }
    if (calls_.size() <= unsent_) return end({"it does not answer as Redis does"});  // nothing was asked
    const Done done = std::move(calls_.front());
    calls_.pop_front();
    done({Answer::Kind::kReply, std::move(reply)});
  }
}

void Link::tick() {
  if ((isOpen_ && calls_.empty()) || hasEnded_ || Clock::now() - progress_ < kPatience) return;
  end({"it has not answered for " + std::to_string(kPatience.count()) + " seconds"});
}

void Link::close() {
  hasEnded_ = true;
  resolver_.cancel();
  error_code ignored;
  socket_.close(ignored);
  if (channel_) channel_->close();
}

void Link::abandon() {
  close();
  calls_.clear();
}

void Link::end(const Fault& fault) {
  if (hasEnded_) return;
  close();
  const auto calls = std::exchange(calls_, {});
  if (!fault.why.empty()) events_.ended(fault);
  for (std::size_t i = 0; i < calls.size(); ++i) calls[i]({i + unsent_ < calls.size() ? Answer::Kind::kLost : Answer::Kind::kUnsent, {}});
}

}  // namespace ridgecast::bus
