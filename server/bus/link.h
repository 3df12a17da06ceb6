#pragma once
// One connection to Redis: commands in order, a reply to each, and what is pushed in between. Ends by itself when an answer takes too long.
//
//   open() -> resolve -> connect -> (TLS) -> AUTH, SELECT -> opened --+
//      any of these fails ------------------------------------> ended <-+ closed, silent, no Redis; once, before what is lost is told
//
// On the thread of its io_context alone. Heavy: for .cpp files that see sockets.

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/transport/channel.h"
#include "server/bus/address.h"
#include "server/bus/protocol.h"

namespace ridgecast::bus {

class Link final : public std::enable_shared_from_this<Link> {
 public:
  static constexpr std::chrono::seconds kPatience{2};  // without a byte while something is asked, and to open

  struct Answer {
    enum class Kind { kReply, kUnsent, kLost } kind = Kind::kUnsent;  // kLost: sent, and never answered
    Reply reply{};
  };
  using Done = std::function<void(Answer)>;
  struct Fault {
    std::string why;       // the end of a sentence, such as "it refuses connections"
    bool isFinal = false;  // another try will end like this one
  };
  struct Events {
    std::function<void()> opened;
    std::function<void(const Reply&)> pushed;  // empty: this connection subscribes to nothing
    std::function<void(const Fault&)> ended;
  };

  // `ca`: file of the authorities that may have signed the engine's certificate; empty: the system's.
  Link(boost::asio::io_context& io, Address address, std::string ca, Events events);

  void open();
  void send(std::string command, Done done);  // done is called once; after `ended` if there is no reply
  bool isIdle() const { return calls_.empty(); }
  void tick();  // a few times a second: looks whether an answer takes too long
  // What is asked is lost. Calls `ended`, unless the fault is empty.
  void end(const Fault& fault);
  void abandon();  // closes, and calls nobody any more

 private:
  using Clock = std::chrono::steady_clock;
  using error_code = boost::system::error_code;

  void close();
  void connect(const boost::asio::ip::tcp::resolver::results_type& places);
  void secure();
  void greet();
  void read();
  void received(std::size_t bytes);
  void write();

  const Address address_;
  const std::string ca_;
  Events events_;
  boost::asio::ip::tcp::resolver resolver_;
  boost::asio::ip::tcp::socket socket_;  // until it is the channel's
  std::optional<transport::Channel> channel_;
  bool isOpen_ = false, hasEnded_ = false;
  Clock::time_point progress_;  // when the last byte came, or the first command without an answer went
  std::deque<Done> calls_;      // without an answer; their number is their caller's to bound
  std::size_t unsent_ = 0;      // the last of them, whose bytes wait
  std::string waiting_, writing_;
  std::array<char, 1 << 16> buffer_{};
  ReplyReader reader_;
};

}  // namespace ridgecast::bus
