#include "server/access/jwt.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/access/crypto.h"

namespace ridgecast::access {

namespace {

using nlohmann::json;

std::string text(const Digest& digest) { return {digest.begin(), digest.end()}; }

json parsed(std::string_view part) {  // discarded when it is no JSON
  const auto bytes = fromBase64url(part);
  return bytes ? json::parse(*bytes, nullptr, false) : json(json::value_t::discarded);
}

// Seconds since 1970.
std::optional<Time> timeOf(const json& value) {
  if (!value.is_number()) return std::nullopt;
  const double seconds = value.get<double>();
  if (!(seconds >= 0)) return std::nullopt;
  return Time(std::chrono::seconds(static_cast<long long>(std::min(seconds, static_cast<double>(kLatest.time_since_epoch().count())))));
}

Outcome<Rights> rightsOf(const json& claims) {
  const auto claim = claims.find("rights");
  if (claim == claims.end()) return Error{"The token names no rights."};
  if (claim->is_string()) return parseRights(claim->get_ref<const std::string&>());
  Rights rights;
  if (claim->is_array())
    for (const json& one : *claim) {
      if (!one.is_string()) return Error{"The token's rights are not a list of names."};
      const auto right = parseRights(one.get_ref<const std::string&>());
      if (!right) return right.error();
      rights = rights | *right;
    }
  if (rights.empty()) return Error{"The token names no rights."};
  return rights;
}

}  // namespace

Outcome<Grant> verifyJwt(std::string_view token, std::span<const Key> keys, Time now) {
  const auto first = token.find('.');
  const auto second = first == std::string_view::npos ? first : token.find('.', first + 1);
  if (token.size() > kMaxTokenBytes || second == std::string_view::npos || token.find('.', second + 1) != std::string_view::npos)
    return Error{"The token is not a JSON Web Token."};
  const auto signature = fromBase64url(token.substr(second + 1));
  const auto signer = signature
                          ? std::ranges::find_if(keys, [&](const Key& key) { return key.verifies(token.substr(0, second), *signature); })
                          : keys.end();
  if (signer == keys.end()) return Error{"The token's signature is wrong."};

  const json header = parsed(token.substr(0, first)), claims = parsed(token.substr(first + 1, second - first - 1));
  if (!header.is_object() || !claims.is_object()) return Error{"The token is not a JSON Web Token."};
  const auto algorithm = header.find("alg");
  if (algorithm == header.end() || *algorithm != signer->algorithm())
    return Error{"The token names another algorithm than its key's, " + std::string(signer->algorithm()) + "."};
  if (header.contains("crit")) return Error{"The token demands extensions that are not known here."};

  Grant grant;
  const auto exp = claims.find("exp");
  if (exp != claims.end()) grant.expires = timeOf(*exp);
  if (!grant.expires) return Error{"The token does not say when it expires."};
  if (now >= *grant.expires) return Error{"The token has expired."};
  if (const auto nbf = claims.find("nbf"); nbf != claims.end()) {
    const auto begins = timeOf(*nbf);
    if (!begins || now < *begins) return Error{"The token is not valid yet."};
  }
  const auto rights = rightsOf(claims);
  if (!rights) return rights.error();
  grant.rights = *rights;
  if (const auto session = claims.find("session"); session != claims.end()) {
    if (!session->is_string() || !wire::sessionNameIsValid(session->get_ref<const std::string&>()))
      return Error{"The token's session is not a session's name."};
    grant.session = session->get<std::string>();
  }
  if (const auto sub = claims.find("sub"); sub != claims.end() && sub->is_string() && holderNameIsValid(sub->get_ref<const std::string&>()))
    grant.name = sub->get<std::string>();
  return grant;
}

std::string issueJwt(const Grant& grant, std::string_view secret, Time now) {
  expects(grant.expires.has_value(), "a JSON Web Token expires");
  expects(secret.size() >= kMinSecretBytes, "a secret is as long as its hash");
  expects(!grant.rights.empty(), "a token grants something");
  json claims = {
      {"iat", now.time_since_epoch().count()}, {"exp", grant.expires.value().time_since_epoch().count()}, {"rights", toText(grant.rights)}};
  if (!grant.session.empty()) claims["session"] = grant.session;
  if (!grant.name.empty()) claims["sub"] = grant.name;
  const std::string content = base64url(R"({"alg":"HS256","typ":"JWT"})") + "." + base64url(claims.dump());
  return content + "." + base64url(text(hmacSha256(secret, content)));
}

}  // namespace ridgecast::access
