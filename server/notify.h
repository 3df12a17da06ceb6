#pragma once
// Tells systemd how the server is (sd_notify(3)'s protocol: one datagram to the socket that NOTIFY_SOCKET names).

#include <string_view>

namespace ridgecast {

// "READY=1", "STOPPING=1", "STATUS=...", lines of them. Nothing happens where nobody wants to know.
void notify(std::string_view state);

}  // namespace ridgecast
