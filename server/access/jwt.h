#pragma once
// JSON Web Tokens (RFC 7519), signed with HS256, RS256 or ES256 (keys.h) and in no other way. The key, never the token, says which.
//
// Claims: `exp` (required) and `nbf`, seconds since 1970; `rights` (required), a list of names or one text with commas; `session`, the one
// session it is for (absent: all); `sub`, whose it is. Others are ignored; a header with `crit` is refused, as RFC 7515 demands.

#include <span>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/access/keys.h"
#include "server/access/rights.h"

namespace ridgecast::access {

inline constexpr std::size_t kMaxTokenBytes = 4096;

// Verifies the signature, with each key in turn, before it parses header and claims.
Outcome<Grant> verifyJwt(std::string_view token, std::span<const Key> keys, Time now);
// With HS256. `secret` has at least kMinSecretBytes; `grant.expires` must be there.
std::string issueJwt(const Grant& grant, std::string_view secret, Time now);

}  // namespace ridgecast::access
