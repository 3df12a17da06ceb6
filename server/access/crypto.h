#pragma once
// The few primitives that tokens need, from OpenSSL. Any thread.

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace ridgecast::access {

using Digest = std::array<std::uint8_t, 32>;

Digest sha256(std::string_view bytes);
Digest hmacSha256(std::string_view key, std::string_view bytes);
bool equalInConstantTime(std::string_view a, std::string_view b);  // the time reveals only the lengths
// Bytes fit for a secret. Throws std::runtime_error when the system has none.
std::string randomBytes(std::size_t count);

// RFC 4648, section 5, without padding. fromBase64url: nothing if the text is no such encoding, or not the canonical one.
std::string base64url(std::string_view bytes);
std::optional<std::string> fromBase64url(std::string_view text);

std::string hex(const Digest& digest);

}  // namespace ridgecast::access
