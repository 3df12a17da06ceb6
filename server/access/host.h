#pragma once
// The names that a server without tokens answers to.
//
// This prevents DNS rebinding: a page of evil.example points its own name at 127.0.0.1 after it has loaded. The browser then treats the
// server as part of evil.example and sends no foreign Origin; only the Host header shows the name. Accepted are names that nobody else can
// point here: addresses, localhost and names below it (RFC 6761), the name listened on, and those that the operator allows. With tokens
// this is not needed: the page has none.

#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::access {

// Equal except for the case of ASCII letters.
bool sameIgnoringCase(std::string_view a, std::string_view b);

// NAME, an address, or * for every name. Error: a sentence, if there is a port, a scheme or anything else that a name cannot have.
Outcome<std::string> parseHostName(std::string_view text);

// Of a Host header: without its port and the dot that may end it. A header that cannot be one comes back as it is.
std::string_view hostName(std::string_view header);

// Whether a request with this Host header may be meant for this server. Without one (HTTP/1.0, never a browser) it may. Case is ignored.
// `listening`: the name or address that was listened on; `allowed`: as parseHostName() returned them.
bool answersTo(std::string_view header, std::string_view listening, const std::vector<std::string>& allowed);

}  // namespace ridgecast::access
