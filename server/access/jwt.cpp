#include "server/access/jwt.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/outcome/contract.h"
#include "common/text/text.h"
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

// The names in a claim: a list, or a text with these between them. Nothing: it is neither.
std::optional<std::vector<std::string>> namesIn(const json& claim, const char* between) {
  std::vector<std::string> names;
  const auto add = [&](std::string_view text) {
    while (!text.empty()) {
      const auto end = text.find_first_of(between);
      if (end != 0) names.emplace_back(text.substr(0, end));
      text.remove_prefix(end == text.npos ? text.size() : end + 1);
    }
  };
  if (claim.is_string()) return add(claim.get_ref<const std::string&>()), names;
  if (!claim.is_array()) return std::nullopt;
  for (const json& one : claim) {
    if (!one.is_string()) return std::nullopt;
    add(one.get_ref<const std::string&>());
  }
  return names;
}

Outcome<void> readRights(const json& claims, bool isForUs, JwtGrant& grant) {
  const auto read = [&](const char* claim, const char* between) -> Outcome<void> {
    const auto found = claims.find(claim);
    if (found == claims.end()) return {};
    const auto names = namesIn(*found, between);
    if (!names) return Error{"The token's " + std::string(claim) + " are not a list of names."};
    for (const std::string& name : *names)
      if (const auto right = parseRights(name))
        grant.rights = grant.rights | *right;
      else if (grant.unknown.size() < JwtGrant::kMaxUnknown)
        grant.unknown.push_back(text::oneLine(name));
    return {};
  };
  if (claims.contains("rights")) {
    if (auto wrong = read("rights", ","); !wrong) return wrong;
  } else if (isForUs) {
    for (const char* claim : {"scope", "roles"})
      if (auto wrong = read(claim, " "); !wrong) return wrong;
  }
  if (!grant.rights.empty()) return {};
  return Error{grant.unknown.empty() ? "The token names no rights." : "The token names no rights that are known here."};
}

bool names(const json& claims, const char* claim, const std::string& wanted) {
  const auto found = claims.find(claim);
  if (found == claims.end()) return false;
  const auto is = [&](const json& name) { return name == wanted; };
  return found->is_array() ? std::any_of(found->begin(), found->end(), is) : is(*found);
}

}  // namespace

Outcome<JwtGrant> verifyJwt(std::string_view token, std::span<const Key> keys, Time now, const JwtTerms& terms) {
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

  if (!terms.issuer.empty() && !(claims.contains("iss") && claims["iss"] == terms.issuer))
    return Error{"The token is of another issuer than '" + terms.issuer + "'."};
  if (!terms.audience.empty() && !names(claims, "aud", terms.audience))
    return Error{"The token is not for this server, whose audience is '" + terms.audience + "'."};
  JwtGrant grant;
  const auto exp = claims.find("exp");
  if (exp != claims.end())
    if (const auto time = timeOf(*exp)) grant.expires = std::min(*time + terms.leeway, kLatest);
  if (!grant.expires) return Error{"The token does not say when it expires."};
  if (now >= *grant.expires) return Error{"The token has expired."};
  if (const auto nbf = claims.find("nbf"); nbf != claims.end()) {
    const auto begins = timeOf(*nbf);
    if (!begins || now < *begins - terms.leeway) return Error{"The token is not valid yet."};
  }
  if (auto wrong = readRights(claims, !terms.audience.empty(), grant); !wrong) return wrong.error();
  if (const auto session = claims.find("session"); session != claims.end()) {
    if (!session->is_string() || !wire::sessionNameIsValid(session->get_ref<const std::string&>()))
      return Error{"The token's session is not a session's name."};
    grant.session = session->get<std::string>();
  }
  if (const auto sub = claims.find("sub"); sub != claims.end() && sub->is_string() && holderNameIsValid(sub->get_ref<const std::string&>()))
    grant.name = sub->get<std::string>();
  return grant;
}

std::string keyIdOf(std::string_view token) {
  if (token.size() > kMaxTokenBytes) return {};
  const json header = parsed(token.substr(0, token.find('.')));
  if (!header.is_object()) return {};
  const auto id = header.find("kid");
  return id != header.end() && id->is_string() ? id->get<std::string>() : std::string();
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
