#include "server/access/keys.h"

#include <openssl/bio.h>
#include <openssl/bn.h>
#include <openssl/core_names.h>
#include <openssl/ecdsa.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/param_build.h>
#include <openssl/pem.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/text/file.h"
#include "server/access/crypto.h"

namespace ridgecast::access {

namespace {

using nlohmann::json;

constexpr std::size_t kMaxSecretBytes = 4096;
constexpr std::size_t kHalf = 32;  // of an ES256 signature and of a point of P-256

template <auto Free>
struct Freed {
  void operator()(auto* object) const { Free(object); }
};
using Bio = std::unique_ptr<BIO, Freed<BIO_free>>;
using Number = std::unique_ptr<BIGNUM, Freed<BN_free>>;
using Context = std::unique_ptr<EVP_MD_CTX, Freed<EVP_MD_CTX_free>>;
using Signature = std::unique_ptr<ECDSA_SIG, Freed<ECDSA_SIG_free>>;

const unsigned char* octets(std::string_view bytes) { return reinterpret_cast<const unsigned char*>(bytes.data()); }

Number number(std::string_view bytes) { return Number(BN_bin2bn(octets(bytes), static_cast<int>(bytes.size()), nullptr)); }

// r and s, 32 bytes each (RFC 7518, section 3.4), as OpenSSL reads them; empty: they are none.
std::string asDer(std::string_view signature) {
  if (signature.size() != 2 * kHalf) return {};
  const Signature both(ECDSA_SIG_new());
  Number r = number(signature.substr(0, kHalf)), s = number(signature.substr(kHalf));
  if (!both || !r || !s || ECDSA_SIG_set0(both.get(), r.get(), s.get()) != 1) return {};
  (void)r.release();
  (void)s.release();
  unsigned char* der = nullptr;
  const int size = i2d_ECDSA_SIG(both.get(), &der);
  if (size <= 0) return {};
  std::string out(reinterpret_cast<const char*>(der), static_cast<std::size_t>(size));
  OPENSSL_free(der);
  return out;
}

std::shared_ptr<EVP_PKEY> shared(EVP_PKEY* key) { return {key, EVP_PKEY_free}; }

// Null: not a key.
std::shared_ptr<EVP_PKEY> build(const char* type, const std::function<bool(OSSL_PARAM_BLD*)>& fill) {
  const std::unique_ptr<OSSL_PARAM_BLD, Freed<OSSL_PARAM_BLD_free>> builder(OSSL_PARAM_BLD_new());
  if (!builder || !fill(builder.get())) return nullptr;
  const std::unique_ptr<OSSL_PARAM, Freed<OSSL_PARAM_free>> parameters(OSSL_PARAM_BLD_to_param(builder.get()));
  const std::unique_ptr<EVP_PKEY_CTX, Freed<EVP_PKEY_CTX_free>> context(EVP_PKEY_CTX_new_from_name(nullptr, type, nullptr));
  EVP_PKEY* key = nullptr;
  if (parameters && context && EVP_PKEY_fromdata_init(context.get()) == 1)
    EVP_PKEY_fromdata(context.get(), &key, EVP_PKEY_PUBLIC_KEY, parameters.get());
  ERR_clear_error();
  return key ? shared(key) : nullptr;
}

std::optional<std::string> bytesOf(const json& key, const char* name) {
  const auto found = key.find(name);
  if (found == key.end() || !found->is_string()) return std::nullopt;
  return fromBase64url(found->get_ref<const std::string&>());
}

bool is(const json& key, const char* name, const char* value) {
  const auto found = key.find(name);
  return found == key.end() || *found == value;
}

std::shared_ptr<EVP_PKEY> rsaKey(const json& key) {
  const auto modulus = bytesOf(key, "n"), exponent = bytesOf(key, "e");
  if (!modulus || !exponent) return nullptr;
  const Number n = number(*modulus), e = number(*exponent);
  return build("RSA", [&](OSSL_PARAM_BLD* builder) {
    return OSSL_PARAM_BLD_push_BN(builder, OSSL_PKEY_PARAM_RSA_N, n.get()) == 1 &&
           OSSL_PARAM_BLD_push_BN(builder, OSSL_PKEY_PARAM_RSA_E, e.get()) == 1;
  });
}

std::shared_ptr<EVP_PKEY> curveKey(const json& key) {
  const auto x = bytesOf(key, "x"), y = bytesOf(key, "y");
  if (!x || !y || x->size() != kHalf || y->size() != kHalf) return nullptr;
  const std::string point = "\x04" + *x + *y;  // uncompressed
  return build("EC", [&](OSSL_PARAM_BLD* builder) {
    return OSSL_PARAM_BLD_push_utf8_string(builder, OSSL_PKEY_PARAM_GROUP_NAME, "prime256v1", 0) == 1 &&
           OSSL_PARAM_BLD_push_octet_string(builder, OSSL_PKEY_PARAM_PUB_KEY, point.data(), point.size()) == 1;
  });
}

}  // namespace

Outcome<Key> Key::of(std::shared_ptr<evp_pkey_st> key) {
  const bool rsa = EVP_PKEY_is_a(key.get(), "RSA") == 1;
  if (rsa && EVP_PKEY_get_bits(key.get()) < kMinRsaBits)
    return Error{"a key of RSA has " + std::to_string(EVP_PKEY_get_bits(key.get())) + " bits, and at least " + std::to_string(kMinRsaBits) +
                 " are needed"};
  if (rsa) return Key(std::move(key), "RS256");
  char group[32] = {};
  std::size_t size = 0;
  if (EVP_PKEY_get_group_name(key.get(), group, sizeof group, &size) == 1 && std::string_view(group, size) == "prime256v1")
    return Key(std::move(key), "ES256");
  ERR_clear_error();
  return Error{"a key is neither of RSA nor of the curve P-256"};
}

Outcome<std::vector<Key>> Key::readPem(const std::string& text) {
  const Bio in(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  std::vector<Key> keys;
  while (EVP_PKEY* const next = in ? PEM_read_bio_PUBKEY(in.get(), nullptr, nullptr, nullptr) : nullptr) {
    auto key = of(shared(next));
    if (!key) return key.error();
    keys.push_back(std::move(*key));
    if (keys.size() > kMaxKeys) break;
  }
  ERR_clear_error();
  if (keys.empty()) return Error{"it holds no public key; 'openssl pkey -pubout' writes one"};
  return keys;
}

Outcome<std::vector<Key>> Key::readSet(const std::string& text) {
  const json set = json::parse(text, nullptr, false);
  const auto members = set.find("keys");
  if (!set.is_object() || members == set.end() || !members->is_array()) return Error{"it is not a set of keys (RFC 7517)"};
  std::vector<Key> keys;
  for (const json& member : *members) {
    if (!member.is_object() || !is(member, "use", "sig")) continue;
    const auto type = member.find("kty");
    const bool rsa = type != member.end() && *type == "RSA" && is(member, "alg", "RS256");
    const bool curve = type != member.end() && *type == "EC" && is(member, "crv", "P-256") && is(member, "alg", "ES256");
    if (!rsa && !curve) continue;
    auto built = rsa ? rsaKey(member) : curveKey(member);
    if (!built) return Error{"a key of it is broken"};
    auto key = of(std::move(built));
    if (!key) return key.error();
    if (const auto id = member.find("kid"); id != member.end() && id->is_string()) key->id_ = id->get<std::string>();
    keys.push_back(std::move(*key));
  }
  if (keys.empty()) return Error{"it has no key for RS256 or ES256"};
  if (keys.size() > kMaxKeys) return Error{"it has more than " + std::to_string(kMaxKeys) + " keys"};
  return keys;
}

Outcome<std::vector<Key>> Key::readPublic(const std::filesystem::path& file) {
  const auto text = text::readFile(file, kMaxKeyBytes);
  if (!text) return Error{"Cannot read the key file '" + file.string() + "'."};
  const std::string where = "The key file '" + file.string() + "' cannot be used: ";
  if (text->size() > kMaxKeyBytes) return Error{where + "it is longer than 64 KiB."};
  const auto first = text->find_first_not_of(" \t\r\n");
  auto keys = first != std::string::npos && (*text)[first] == '{' ? readSet(*text) : readPem(*text);
  if (!keys) return Error{where + keys.error().message + "."};
  if (keys->size() > kMaxKeys) return Error{where + "it has more than " + std::to_string(kMaxKeys) + " keys."};
  return keys;
}

bool Key::verifies(std::string_view content, std::string_view signature) const {
  if (!key_) {
    const Digest right = hmacSha256(secret_, content);
    return equalInConstantTime(signature, {reinterpret_cast<const char*>(right.data()), right.size()});
  }
  const std::string der = algorithm_ == "ES256" ? asDer(signature) : std::string(signature);
  const Context context(EVP_MD_CTX_new());
  const bool good = context && !der.empty() && EVP_DigestVerifyInit(context.get(), nullptr, EVP_sha256(), nullptr, key_.get()) == 1 &&
                    EVP_DigestVerify(context.get(), octets(der), der.size(), octets(content), content.size()) == 1;
  ERR_clear_error();
  return good;
}

Outcome<std::string> loadSecret(const std::filesystem::path& file) {
  auto secret = text::readFile(file, kMaxSecretBytes);
  if (!secret) return Error{"Cannot read the secret file '" + file.string() + "'."};
  secret->resize(secret->find_last_not_of("\r\n") + 1);
  if (secret->size() < kMinSecretBytes || secret->size() > kMaxSecretBytes)
    return Error{"The secret in '" + file.string() + "' must have " + std::to_string(kMinSecretBytes) + " to " +
                 std::to_string(kMaxSecretBytes) + " bytes; 'openssl rand -hex 32' makes a good one."};
  return Outcome<std::string>(boost::system::in_place_value, std::move(*secret));
}

}  // namespace ridgecast::access
