#pragma once
// The names that a server without tokens answers to.
//
// This prevents DNS rebinding: a page of evil.example lets its own name point to 127.0.0.1 after it was loaded. The browser then takes the
// server for a part of evil.example and sends no foreign Origin; only the Host header shows the name. Accepted are names that nobody else
// can point here: addresses, localhost and names below it (RFC 6761), the name listened on, and those that the operator allows. With tokens
// there is no need: the page has none.

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
bool answersTo(std::string_view header, std::string_view listening, const std::vector<std::string>& allowed);

}  // namespace ridgecast::access
