#include "server/access/tokens.h"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <vector>

#include "common/wire/wire.h"
#include "server/access/crypto.h"
#include "server/access/jwt.h"

namespace ridgecast::access {

namespace {

constexpr std::size_t kMaxTokens = 100'000, kMaxLineBytes = 1024, kMaxSecretBytes = 4096;
constexpr std::string_view kHashPrefix = "sha256:";

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
  const std::string_view hash = words[4];
  if (!hash.starts_with(kHashPrefix) || !digestFromHex(hash.substr(kHashPrefix.size())))
    return Error{"its hash is not sha256: and 64 hexadecimal digits, as 'ridgecast-server token' writes them"};
  return std::pair(std::move(grant), std::string(hash.substr(kHashPrefix.size())));
}

}  // namespace

std::optional<Time> parseTime(std::string_view text) {
  const std::string_view form = "dddd-dd-ddTdd:dd:ddZ";
  if (text.size() != form.size()) return std::nullopt;
  for (std::size_t k = 0; k < form.size(); ++k)
    if (form[k] == 'd' ? text[k] < '0' || text[k] > '9' : text[k] != form[k]) return std::nullopt;
  const auto number = [&](std::size_t at, std::size_t digits) {
    int value = 0;
    std::from_chars(text.data() + at, text.data() + at + digits, value);
    return value;
  };
  const std::chrono::year_month_day day{std::chrono::year(number(0, 4)), std::chrono::month(static_cast<unsigned>(number(5, 2))),
                                        std::chrono::day(static_cast<unsigned>(number(8, 2)))};
  const int hour = number(11, 2), minute = number(14, 2), second = number(17, 2);
  if (!day.ok() || hour > 23 || minute > 59 || second > 59) return std::nullopt;
  return Time(std::chrono::sys_days(day)) + std::chrono::hours(hour) + std::chrono::minutes(minute) + std::chrono::seconds(second);
}

std::string toText(Time time) {
  const auto days = std::chrono::floor<std::chrono::days>(time);
  const std::chrono::year_month_day day(days);
  const std::chrono::hh_mm_ss clock(time - days);
  char out[40];
  std::snprintf(out, sizeof out, "%04d-%02u-%02uT%02d:%02d:%02dZ", static_cast<int>(day.year()), static_cast<unsigned>(day.month()),
                static_cast<unsigned>(day.day()), static_cast<int>(clock.hours().count()), static_cast<int>(clock.minutes().count()),
                static_cast<int>(clock.seconds().count()));
  return out;
}

Outcome<std::string> loadSecret(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string secret(kMaxSecretBytes + 1, '\0');
  in.read(secret.data(), static_cast<std::streamsize>(secret.size()));
  if (in.bad() || (!in.eof() && in.gcount() == 0)) return Error{"Cannot read the secret file '" + file.string() + "'."};
  secret.resize(static_cast<std::size_t>(in.gcount()));
  while (!secret.empty() && (secret.back() == '\n' || secret.back() == '\r')) secret.pop_back();
  if (secret.size() < kMinSecretBytes || secret.size() > kMaxSecretBytes)
    return Error{"The secret in '" + file.string() + "' must have " + std::to_string(kMinSecretBytes) + " to " +
                 std::to_string(kMaxSecretBytes) + " bytes; 'openssl rand -hex 32' makes a good one."};
  return Outcome<std::string>(boost::system::in_place_value, std::move(secret));
}

Outcome<std::shared_ptr<const Tokens>> Tokens::load(const std::filesystem::path& tokenFile, const std::filesystem::path& jwtSecretFile) {
  auto tokens = std::make_shared<Tokens>();
  if (!jwtSecretFile.empty()) {
    auto secret = loadSecret(jwtSecretFile);
    if (!secret) return secret.error();
    tokens->secret_ = std::move(*secret);
  }
  if (!tokenFile.empty()) {
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
      if (tokens->byHash_.size() >= kMaxTokens) return Error{where + "there are more than " + std::to_string(kMaxTokens) + " tokens."};
      tokens->byHash_.insert_or_assign(std::move(parsed->second), std::move(parsed->first));
    }
    if (in.bad()) return Error{"Cannot read the token file '" + tokenFile.string() + "'."};
  }
  return std::shared_ptr<const Tokens>(std::move(tokens));
}

Outcome<Grant> Tokens::judge(std::string_view token, Time now) const {
  if (token.empty() || token.size() > kMaxTokenBytes) return Error{"The token has no length that a token can have."};
  if (!secret_.empty() && token.find('.') != std::string_view::npos) return verifyJwt(token, secret_, now);
  const auto found = byHash_.find(hex(sha256(token)));
  if (found == byHash_.end()) return Error{"The token is not known here."};
  if (found->second.expires && now >= *found->second.expires) return Error{"The token has expired."};
  return found->second;
}

NewToken makeToken(const Grant& grant) {
  NewToken made;
  made.token = "rc_" + base64url(randomBytes(32));
  made.line = grant.name + " " + toText(grant.rights) + " " + (grant.session.empty() ? "*" : grant.session) + " " +
              (grant.expires ? toText(*grant.expires) : "never") + " " + std::string(kHashPrefix) + hex(sha256(made.token));
  return made;
}

}  // namespace ridgecast::access
