#pragma once
// JSON Web Tokens (RFC 7519), signed with HMAC-SHA256 ("HS256") and in no other way.
//
// Claims: `exp` (required) and `nbf`, seconds since 1970; `rights` (required), a list of names or one text with commas; `session`, the one
// session it is for (absent: all); `sub`, whose it is. Others are ignored; a header with `crit` is refused, as RFC 7515 demands.

#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/access/rights.h"

namespace ridgecast::access {

inline constexpr std::size_t kMaxTokenBytes = 4096;
inline constexpr std::size_t kMinSecretBytes = 32;  // RFC 7518, section 3.2

// `secret` has at least kMinSecretBytes. The signature is judged, in constant time, before anything of the token is parsed.
Outcome<Grant> verifyJwt(std::string_view token, std::string_view secret, Time now);
// `grant.expires` must be there.
std::string issueJwt(const Grant& grant, std::string_view secret, Time now);

}  // namespace ridgecast::access
