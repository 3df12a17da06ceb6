#pragma once
// The address of a server, and what is wanted there.

#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::core {

struct Url {
  std::string host = "127.0.0.1";
  std::string port = "7070";
  std::string session = "default";
  // The session's world, "terrain=NAME&seed=N&param=NAME=NUMBER&clock=stepped" or parts of it. If there is no such session and a terrain is
  // named, the server makes it; an existing session must have that world.
  std::string world = {};
  bool secure = false;     // speak TLS
  std::string ca = {};     // file of authorities to trust (PEM); empty: those of this system
  std::string token = {};  // shown to the server; empty: none

  std::string where() const;  // HOST:PORT
};

// host, host:port, [ipv6]:port, http:// or ws:// before it, optional path (ignored) and
// ?session=NAME&terrain=NAME&seed=N&param=NAME=NUMBER&clock=stepped (other parameters are ignored).
// Without a port: 7070, 80 behind http:// or ws://, 443 behind https:// or wss://, which speak TLS. Empty text: the defaults.
Outcome<Url> parseUrl(std::string_view text);

}  // namespace ridgecast::core
