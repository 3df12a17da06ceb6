#pragma once
// The way from a session to one client.

#include <cstddef>
#include <memory>

#include "common/wire/messages.h"

namespace ridgecast::session {

// Any thread; no call blocks or calls back into the session.
class Sender {
 public:
  virtual ~Sender() = default;
  virtual void send(wire::ServerMessage message) = 0;
  // The same; `ticket` is let go once the message has left for the operating system, or is dropped. Who holds a weak pointer to it knows
  // whether the message still waits, and need not send the next one of its kind behind it.
  virtual void send(wire::ServerMessage message, std::shared_ptr<const void> ticket) {
    send(std::move(message));
    ticket.reset();
  }
  virtual std::size_t queuedBytes() const = 0;        // not yet handed to the operating system
  virtual void fail(wire::ErrorMessage message) = 0;  // sends the message, then ends the connection
};

}  // namespace ridgecast::session
