#include "server/access/tokens.h"

#include <ctime>
#include <fstream>
#include <sstream>
#include <vector>

#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/access/crypto.h"
#include "server/access/jwt.h"

namespace ridgecast::access {

namespace {

constexpr std::size_t kMaxTokens = 100'000, kMaxLineBytes = 1024;
constexpr std::string_view kHashPrefix = "sha256:";
constexpr char kTimeForm[] = "%Y-%m-%dT%H:%M:%SZ";

// One line of the file: the grant and the token's hash.
Outcome<std::pair<Grant, std::string>> parseLine(const std::string& line) {
  std::vector<std::string> words;
  std::istringstream in(line);
  for (std::string word; in >> word;) words.push_back(word);
  if (words.size() != 5)
    return Error{"it has " + std::to_string(words.size()) + " words instead of 5 (holder, rights, session, expires, hash)"};
  Grant grant;
  if (!holderNameIsValid(words[0])) return Error{"its holder is not 1 to 64 letters, digits, '.', '_', '-' or '@'"};
  grant.name = words[0];
  const auto rights = parseRights(words[1]);
  if (!rights) return Error{rights.error().message};
  grant.rights = *rights;
  if (words[2] != "*") {
    if (!wire::sessionNameIsValid(words[2])) return Error{"its session is neither a session's name nor *"};
    grant.session = words[2];
  }
  if (words[3] != "never") {
    const auto expires = parseTime(words[3]);
    if (!expires) return Error{"its end is neither 'never' nor a time like 2027-01-01T00:00:00Z"};
    grant.expires = std::min(*expires, kLatest);
  }
  const std::string hash = words[4].starts_with(kHashPrefix) ? words[4].substr(kHashPrefix.size()) : "";
  if (hash.size() != 2 * Digest().size() || hash.find_first_not_of("0123456789abcdef") != std::string::npos)
    return Error{"its hash is not sha256: and 64 hexadecimal digits, as 'ridgecast-server token' writes them"};
  return std::pair(std::move(grant), hash);
}

}  // namespace

std::optional<Time> parseTime(std::string_view text) {
  std::tm parts{};
  if (!strptime(std::string(text).c_str(), kTimeForm, &parts)) return std::nullopt;
  const Time time(std::chrono::seconds(timegm(&parts)));
  if (toText(time) != text) return std::nullopt;  // strptime also takes blanks, fewer digits and days such as 31 June
  return time;
}

std::string toText(Time time) {
  const std::time_t seconds = time.time_since_epoch().count();
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char out[40];
  return {out, std::strftime(out, sizeof out, kTimeForm, &parts)};
}

Outcome<std::shared_ptr<const Tokens>> Tokens::load(const Files& files) {
  auto tokens = std::make_shared<Tokens>();
  auto byHash = std::make_shared<ByHash>();
  tokens->jwt_ = files.jwt;
  for (const auto& file : files.secrets) {
    auto secret = loadSecret(file);
    if (!secret) return secret.error();
    tokens->keys_.emplace_back(std::move(*secret));
  }
  for (const auto& file : files.keys) {
    auto keys = Key::readPublic(file);
    if (!keys) return keys.error();
    tokens->keys_.insert(tokens->keys_.end(), keys->begin(), keys->end());
  }
  if (tokens->keys_.size() > kMaxKeys) return Error{"There are more than " + std::to_string(kMaxKeys) + " secrets and keys."};
  if (!files.tokens.empty()) {
    const std::filesystem::path& tokenFile = files.tokens;
    std::ifstream in(tokenFile);
    if (!in) return Error{"Cannot read the token file '" + tokenFile.string() + "'."};
    std::size_t number = 0;
    for (std::string line; std::getline(in, line);) {
      ++number;
      const std::string where = "Line " + std::to_string(number) + " of the token file '" + tokenFile.string() + "' is wrong: ";
      if (line.size() > kMaxLineBytes) return Error{where + "it has more than " + std::to_string(kMaxLineBytes) + " bytes."};
      const auto begin = line.find_first_not_of(" \t\r");
      if (begin == std::string::npos || line[begin] == '#') continue;
      auto parsed = parseLine(line);
      if (!parsed) return Error{where + parsed.error().message + "."};
      if (byHash->size() >= kMaxTokens) return Error{where + "there are more than " + std::to_string(kMaxTokens) + " tokens."};
      byHash->insert_or_assign(std::move(parsed->second), std::move(parsed->first));
    }
    if (in.bad()) return Error{"Cannot read the token file '" + tokenFile.string() + "'."};
  }
  tokens->byHash_ = std::move(byHash);
  tokens->ofFiles_ = tokens->keys_.size();
  return std::shared_ptr<const Tokens>(std::move(tokens));
}

std::shared_ptr<const Tokens> Tokens::with(std::span<const Key> issuers) const {
  auto out = std::make_shared<Tokens>(*this);
  out->keys_.erase(out->keys_.begin() + static_cast<std::ptrdiff_t>(ofFiles_), out->keys_.end());
  out->keys_.insert(out->keys_.end(), issuers.begin(), issuers.end());
  return out;
}

Outcome<JwtGrant> Tokens::judge(std::string_view token, Time now) const {
  if (token.empty() || token.size() > kMaxTokenBytes) return Error{"The token is too short or too long to be one."};
  if (!keys_.empty() && token.find('.') != std::string_view::npos) return verifyJwt(token, keys_, now, jwt_);
  const auto found = byHash_->find(hex(sha256(token)));
  if (found == byHash_->end()) return Error{"The token is not known here."};
  if (found->second.expires && now >= *found->second.expires) return Error{"The token has expired."};
  return JwtGrant{found->second, {}};
}

std::vector<std::string> Tokens::missingFrom(const Tokens& other) const {
  std::vector<std::string> missing;
  for (const auto& [hash, grant] : *byHash_)
    if (!other.byHash_->contains(hash)) missing.push_back(hash);
  return missing;
}

std::optional<std::string> Tokens::holderOf(const std::string& hash) const {
  const auto found = byHash_->find(hash);
  return found == byHash_->end() ? std::nullopt : std::optional(found->second.name);
}

std::shared_ptr<const Tokens> Tokens::without(const std::vector<std::string>& hashes) const {
  auto fewer = std::make_shared<Tokens>(*this);
  auto byHash = std::make_shared<ByHash>(*byHash_);
  for (const std::string& hash : hashes) byHash->erase(hash);
  fewer->byHash_ = std::move(byHash);
  return fewer;
}

NewToken makeToken(const Grant& grant) {
  expects(holderNameIsValid(grant.name) && !grant.rights.empty(), "a line of the token file can be read again");
  NewToken made;
  made.token = "rc_" + base64url(randomBytes(32));
  made.line = grant.name + " " + toText(grant.rights) + " " + (grant.session.empty() ? "*" : grant.session) + " " +
              (grant.expires ? toText(*grant.expires) : "never") + " " + std::string(kHashPrefix) + hex(sha256(made.token));
  return made;
}

}  // namespace ridgecast::access
