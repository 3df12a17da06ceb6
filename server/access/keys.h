#pragma once
// Keys that verify JSON Web Token signatures: secrets (HS256), and public keys for RSA (RS256) and the curve P-256 (ES256).

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

struct evp_pkey_st;  // OpenSSL's

namespace ridgecast::access {

inline constexpr std::size_t kMinSecretBytes = 32;   // RFC 7518, section 3.2
inline constexpr int kMinRsaBits = 2048;             // section 3.3
inline constexpr std::size_t kMaxKeys = 16;          // of all files together, and as many of an issuer's URL
inline constexpr std::size_t kMaxKeyBytes = 65'536;  // of a file, and of the answer of that URL

// Immutable; any thread.
class Key {
 public:
  explicit Key(std::string secret) : secret_(std::move(secret)) {  // at least kMinSecretBytes
    expects(secret_.size() >= kMinSecretBytes, "a secret is as long as its hash");
  }
  // The public keys in a file: PEM, one or more, or a JSON Web Key Set (RFC 7517), in which keys for other purposes are skipped.
  // Error: unreadable, longer than kMaxKeyBytes, neither of the two, no key that is usable here, more than kMaxKeys.
  static Outcome<std::vector<Key>> readPublic(const std::filesystem::path& file);
  // Those of a JSON Web Key Set. Error: what is wrong with "it".
  static Outcome<std::vector<Key>> readSet(const std::string& text);

  // The one algorithm that this key is for (RFC 7518, section 3.1).
  std::string_view algorithm() const { return algorithm_; }
  // The `kid` that its set gives it; empty: none.
  const std::string& id() const { return id_; }
  bool verifies(std::string_view content, std::string_view signature) const;

 private:
  explicit Key(std::shared_ptr<evp_pkey_st> key, std::string_view algorithm) : algorithm_(algorithm), key_(std::move(key)) {}
  static Outcome<Key> of(std::shared_ptr<evp_pkey_st> key);
  static Outcome<std::vector<Key>> readPem(const std::string& text);

  std::string_view algorithm_ = "HS256";
  std::string secret_, id_;
  std::shared_ptr<evp_pkey_st> key_;
};

// A secret's file: its bytes without the end of line. Error: unreadable, or shorter than 32 bytes.
Outcome<std::string> loadSecret(const std::filesystem::path& file);

}  // namespace ridgecast::access
