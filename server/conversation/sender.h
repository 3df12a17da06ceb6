#pragma once
// The way to one client.

#include <atomic>
#include <cstddef>
#include <exception>
#include <memory>
#include <new>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/messages.h"

namespace ridgecast::conversation {

// A request stays open until the last copy is released.
inline std::shared_ptr<const void> ticketOf(std::shared_ptr<std::atomic<std::size_t>> open) {
  return {nullptr, [open = std::move(open)](const void*) { expects(open->fetch_sub(1) > 0, "a request that is answered was open"); }};
}

// What a client is told of a failure in its work, which ends only its camera.
inline wire::ErrorMessage failureOf(const std::exception& failure) {
  if (dynamic_cast<const std::bad_alloc*>(&failure))
    return {wire::ErrorCode::kLimit, "The server ran out of memory at this camera's work; connect again with a smaller triangle budget."};
  return {wire::ErrorCode::kInternal, std::string("The server failed: ") + failure.what()};
}

// Any thread. No call blocks or calls back.
class Sender {
 public:
  virtual ~Sender() = default;
  // `ticket` is released once the message has left for the operating system or is dropped. The holder of a weak pointer to it can
  // see whether the message is still queued, and need not send another of its kind.
  virtual void send(wire::ServerMessage message, std::shared_ptr<const void> ticket = {}) = 0;
  // The same for a message sent to many: its wire::encode.
  virtual void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) = 0;
  virtual std::size_t queuedBytes() const = 0;  // not yet handed to the operating system
  // Sends the message, then ends the connection. Anything that running work sends after it is dropped.
  virtual void fail(wire::ErrorMessage message) = 0;
};

}  // namespace ridgecast::conversation
