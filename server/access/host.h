#pragma once
// Under which names a server may be asked that asks nobody for a token.
//
// DNS rebinding: a page of evil.example lets its own name point to 127.0.0.1 after it was loaded. From then on the browser takes the server
// for a part of evil.example: no Origin header tells them apart, for reads have none, and all else has one that equals its Host header. Only
// the name in the Host header gives it away, so only names that nobody else can point here are taken: addresses (they are looked up
// nowhere), localhost and what lies below it (RFC 6761), the name that is listened on, and those that whoever runs the server allows. A
// token does the same, for no other page has it.

#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::access {

// Equal but for the case of ASCII letters.
bool sameIgnoringCase(std::string_view a, std::string_view b);

// NAME, an address, or * for every name. Error: a sentence, for what has a port, a scheme or anything else that no name has.
Outcome<std::string> parseHostName(std::string_view text);

// Of a Host header: without its port and the dot that may end it. A header that cannot be one comes back as it is.
std::string_view hostName(std::string_view header);

// Whether a request with this Host header may be meant for this server. Without one (HTTP/1.0, never a browser) it may. Letters' case does
// not count. `listening`: the name or address that was listened on; `allowed`: as parseHostName() returned them.
bool mayBeAsked(std::string_view header, std::string_view listening, const std::vector<std::string>& allowed);

}  // namespace ridgecast::access
