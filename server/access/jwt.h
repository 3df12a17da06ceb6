#pragma once
// JSON Web Tokens (RFC 7519), signed with HS256, RS256 or ES256 (keys.h) and in no other way. The key, never the token, says which.
//
// Claims: `exp` (required) and `nbf`, seconds since 1970; `rights`, a list of names or one text with commas; `session`, the one session it
// is for (absent: all); `sub`, whose it is; `aud` and `iss`, if the terms name them. A token without `rights` has those of `scope`, a text
// with blanks, and `roles`, a list or such a text, but only under terms with an audience: other servers' roles may have the same names.
// Unknown rights are ignored, as are other claims; a header with `crit` is refused, as RFC 7515 demands.

#include <chrono>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/keys.h"
#include "server/access/rights.h"

namespace ridgecast::access {

inline constexpr std::size_t kMaxTokenBytes = 4096;

// What a server demands of tokens.
struct JwtTerms {
  std::string audience{}, issuer{};  // empty: any
  std::chrono::seconds leeway{0};    // by which other machines' clocks may differ
};

struct JwtGrant : Grant {
  std::vector<std::string> unknown;  // rights, at most kMaxUnknown of them, fit for a line of a log
  static constexpr std::size_t kMaxUnknown = 16;
};

// Verifies the signature, with each key in turn, before it parses header and claims.
Outcome<JwtGrant> verifyJwt(std::string_view token, std::span<const Key> keys, Time now, const JwtTerms& terms = {});
// The `kid` of its header, unverified; empty: it has none, or is no token.
std::string keyIdOf(std::string_view token);
// With HS256. `secret` has at least kMinSecretBytes; `grant.expires` must be there.
std::string issueJwt(const Grant& grant, std::string_view secret, Time now);

}  // namespace ridgecast::access
