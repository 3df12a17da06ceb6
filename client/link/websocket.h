#pragma once
// A WebSocket to a server: looks up, connects, secures, upgrades, and carries opaque frames of bytes. Internal to the room; Beast stays in
// websocket.cpp.
//
//   dialing -> upgrading -> greeting -> streaming -> ended
// Every state may go to ended.
//
// Everything runs on the thread of run(), the listener too, unless stated otherwise.

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "client/link/connection.h"

namespace ridgecast::link {

class WebSocket {
 public:
  struct Listener {
    virtual void opened() = 0;  // the first frame may be sent
    virtual void received(std::span<const std::uint8_t> frame) = 0;
    virtual void sent() = 0;  // the frame has left; the next one may be sent
    // Nothing follows. `retryAfter`: the server refuses for so long.
    virtual void ended(std::string why, std::optional<std::chrono::seconds> retryAfter) = 0;

   protected:
    ~Listener() = default;
  };

  // `timeout`: of each step on the way to greeted(). `listener` must outlive this.
  WebSocket(const core::Url& url, std::chrono::milliseconds timeout, const Waiting& waiting, Listener& listener);
  ~WebSocket();
  WebSocket(const WebSocket&) = delete;
  WebSocket& operator=(const WebSocket&) = delete;

  void run();  // from the beginning to the end; once
  // Any thread.
  void post(std::function<void()> work);
  void giveUp();  // ends it unless greeted
  void part();    // ends run(), without ended(): closes politely if upgraded, within 200 ms

  void send(std::string frame);
  void greeted();                                                           // the server's first frame was the right one
  void after(std::chrono::milliseconds pause, std::function<void()> work);  // replaces what was to come before
  void end(std::string why);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ridgecast::link
