#include "server/config/token_command.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <optional>
#include <string>

#include "common/wire/wire.h"
#include "server/access/jwt.h"
#include "server/access/keys.h"
#include "server/access/tokens.h"

namespace ridgecast::config {

namespace {

// "90s", "15m", "12h", "30d" -> seconds.
std::optional<std::chrono::seconds> parseDuration(const std::string& text) {
  long long number = 0;
  const auto [end, ec] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (ec != std::errc() || number < 1 || number > 100'000 || end + 1 != text.data() + text.size()) return std::nullopt;
  switch (*end) {
    case 's':
      return std::chrono::seconds(number);
    case 'm':
      return std::chrono::minutes(number);
    case 'h':
      return std::chrono::hours(number);
    case 'd':
      return std::chrono::hours(24 * number);
    default:
      return std::nullopt;
  }
}

bool writeLine(int descriptor, const std::string& line) {
  const std::string text = line + "\n";
  return write(descriptor, text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

// Appends in one write. A new file is readable only by its owner.
bool appendLine(const std::filesystem::path& file, const std::string& line) {
  const int descriptor = open(file.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  if (descriptor < 0) return false;
  char last = '\n';
  const off_t size = lseek(descriptor, 0, SEEK_END);
  if (size > 0 && pread(descriptor, &last, 1, size - 1) != 1) last = '\n';
  const bool written = writeLine(descriptor, (last == '\n' ? "" : "\n") + line);
  return close(descriptor) == 0 && written;
}

int refuseCommand(const std::string& sentence) {
  std::cerr << "ridgecast-server token: " << sentence << "\n";
  return 2;
}

}  // namespace

int runTokenCommand(int argc, const char* const* argv) {
  std::string rights = "view", holder = "anyone", expires, session;
  std::filesystem::path tokenFile, secretFile, outFile;
  CLI::App app("Issues a token: a random one, adding its hash to a token file, or a JSON Web Token (HS256).", "ridgecast-server token");
  app.add_option("--rights", rights, "Rights to grant: view, create, query, snapshot, clock, admin, edit, separated by commas")
      ->capture_default_str();
  app.add_option("--holder", holder, "Name of the holder, for the log")->capture_default_str();
  app.add_option("--session", session, "Valid for this session only; default: all")->type_name("NAME");
  app.add_option("--expires", expires, "Lifetime: 90s, 15m, 12h, 30d; default: a JSON Web Token 12h, otherwise unlimited")
      ->type_name("DURATION");
  auto* file = app.add_option("--token-file", tokenFile, "Make a random token and add its hash to this file")->type_name("FILE");
  app.add_option("--jwt-secret-file", secretFile, "Sign a JSON Web Token with the secret in this file")->type_name("FILE")->excludes(file);
  app.add_option("--out", outFile, "Write the token to this file, which only you can read; default: standard output")->type_name("FILE");
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& e) {
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    return refuseCommand(std::string(e.what()) + "; see --help.");
  }
  access::Grant grant;
  const auto parsed = access::parseRights(rights);
  if (!parsed) return refuseCommand(parsed.error().message);
  grant.rights = *parsed;
  if (!access::holderNameIsValid(holder)) return refuseCommand("--holder has 1 to 64 letters, digits, '.', '_', '-' or '@'.");
  grant.name = holder;
  if (!session.empty() && !wire::sessionNameIsValid(session))
    return refuseCommand("--session has 1 to " + std::to_string(wire::kMaxSessionBytes) +
                         " letters, digits, dots, underscores or hyphens.");
  grant.session = session;
  const auto now = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
  if (expires.empty() && !secretFile.empty()) expires = "12h";
  if (!expires.empty()) {
    const auto duration = parseDuration(expires);
    if (!duration) return refuseCommand("--expires takes a number and s, m, h or d, such as 12h, not '" + expires + "'.");
    grant.expires = now + *duration;
  }
  if (secretFile.empty() && tokenFile.empty())
    return refuseCommand("Name where to add the token or what to sign it with: --token-file FILE or --jwt-secret-file FILE.");
  // Opened before a token exists that nobody gets.
  const int out = outFile.empty() ? STDOUT_FILENO : open(outFile.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (out < 0 || (!outFile.empty() && fchmod(out, 0600) != 0)) return refuseCommand("Cannot write to '" + outFile.string() + "'.");
  const auto hand = [&](const std::string& token) { return writeLine(out, token) ? 0 : refuseCommand("Cannot write the token."); };
  if (!secretFile.empty()) {
    const auto secret = access::loadSecret(secretFile);
    if (!secret) return refuseCommand(secret.error().message);
    return hand(access::issueJwt(grant, *secret, now));
  }
  const access::NewToken made = access::makeToken(grant);
  if (!appendLine(tokenFile, made.line)) return refuseCommand("Cannot write to '" + tokenFile.string() + "'.");
  return hand(made.token);
}

}  // namespace ridgecast::config
