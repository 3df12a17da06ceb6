#pragma once
// Who may do what: bearer tokens from a file, and JSON Web Tokens.
//
// A file of tokens has one token a line, of which only the SHA-256 is kept (a token is 256 random bits, so that nothing more is needed):
//
//     # holder   rights       session   expires                hash of the token
//     lab        view,query   *         never                  sha256:9f86d0...
//     guest      view         harbour   2027-01-01T00:00:00Z   sha256:60303a...
//
// Bounds: 100,000 tokens, lines of 1,024 bytes.

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/jwt.h"
#include "server/access/keys.h"
#include "server/access/rights.h"

namespace ridgecast::access {

// The files, and the URL, that a server checks tokens against.
struct Files {
  std::filesystem::path tokens = {};                           // empty: none
  std::vector<std::filesystem::path> secrets = {}, keys = {};  // of JSON Web Tokens (keys.h), all valid at a time
  std::string keyUrl = {};                                     // of more such keys (issuer_keys.h); empty: none
  std::filesystem::path keyAuthorities = {};                   // that vouch for its host, PEM; empty: the system's
  JwtTerms jwt = {};
  bool empty() const { return tokens.empty() && secrets.empty() && keys.empty() && keyUrl.empty(); }
};

// Immutable; any thread.
class Tokens {
 public:
  // Errors, for people: a file cannot be read, a line is wrong (and which), a secret is too short, a key is not usable, too many keys.
  static Outcome<std::shared_ptr<const Tokens>> load(const Files& files);

  // The same with these keys of an issuer beside those of the files, instead of any it had.
  std::shared_ptr<const Tokens> with(std::span<const Key> issuers) const;

  // Error: why it is refused, in one sentence that reveals nothing about the token.
  Outcome<JwtGrant> judge(std::string_view token, Time now) const;

  std::size_t count() const { return byHash_->size(); }
  // The tokens of the file, by their hashes: those of this one that another lacks, whose one is, and this one without some.
  std::vector<std::string> missingFrom(const Tokens& other) const;
  std::optional<std::string> holderOf(const std::string& hash) const;
  std::shared_ptr<const Tokens> without(const std::vector<std::string>& hashes) const;

 private:
  using ByHash = std::unordered_map<std::string, Grant>;  // hex SHA-256 of the token
  std::shared_ptr<const ByHash> byHash_;
  std::vector<Key> keys_;    // none: no JSON Web Tokens
  std::size_t ofFiles_ = 0;  // of keys_, the first
  JwtTerms jwt_;
};

// A new token, and its line for the file.
struct NewToken {
  std::string token, line;
};
NewToken makeToken(const Grant& grant);

// 2027-01-01T00:00:00Z <-> time; nothing when it is not that.
std::optional<Time> parseTime(std::string_view text);
std::string toText(Time time);

}  // namespace ridgecast::access
