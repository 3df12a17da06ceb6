// A file of tokens and a JSON Web Token that is signed with the secret known here, so that its claims are reached.
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "server/access/crypto.h"
#include "server/access/jwt.h"
#include "server/access/keys.h"
#include "server/access/tokens.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ridgecast::access;
  const std::string text(reinterpret_cast<const char*>(data), size);
  static const std::string file = "/dev/shm/fuzz-tokens-" + std::to_string(getpid());
  std::ofstream(file, std::ios::binary) << text;
  const Time now(std::chrono::seconds(1'700'000'000));
  if (const auto tokens = Tokens::load({.tokens = file})) (*tokens)->judge(text, now);
  static const std::string secret(32, 's');
  static const std::vector<Key> keys{Key(secret)};
  const auto judge = [&](const std::string& token) {
    const auto grant = verifyJwt(token, keys, now);
    if (grant ? !grant->expires || *grant->expires <= now || *grant->expires > kLatest : grant.error().message.empty()) std::abort();
  };
  judge(text);
  const Digest signature = hmacSha256(secret, text);
  judge(text + "." + base64url(std::string(signature.begin(), signature.end())));
  return 0;
}
