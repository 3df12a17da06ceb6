#pragma once
// Who may pass: host names of this server, origins of browser pages, bearer tokens. Checked before a request reaches its route, for every
// route alike; only /healthz and /readyz answer under any name.
//
// A token comes as `Authorization: Bearer TOKEN`. Pages cannot set headers of a WebSocket; they offer two subprotocols instead,
// `ridgecast.v1` and `bearer.TOKEN`, and the server selects the first. Viewers of 3D Tiles cannot set headers either: for tilesets a token
// that expires within kLongestInUrl may stand in the query, as token=TOKEN. The header takes precedence.

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/issuer_keys.h"
#include "server/access/tokens.h"
#include "server/http/routes.h"

namespace ridgecast::http {

inline constexpr std::string_view kSubprotocol = "ridgecast.v1";
inline constexpr std::chrono::hours kLongestInUrl{24};  // a URL stands in histories and in the logs of proxies

struct Access {
  std::string host = "127.0.0.1";           // an address or a name of this machine
  access::Files tokens;                     // empty: everybody may do everything
  std::vector<std::string> allowedOrigins;  // of browser pages besides the server's own: https://example.org, *
  std::vector<std::string> allowedHosts;    // besides its addresses, localhost and `host`; used without tokens (access/host.h)
};

class RequestFilter {
 public:
  // `fetch`: as IssuerKeys::Fetch, of Files::keyUrl.
  explicit RequestFilter(const Access& settings, access::IssuerKeys::Fetch fetch = {}) : settings_(settings), fetch_(std::move(fetch)) {}

  // Reads the tokens, also again later. On an error the old ones stay. An issuer whose keys cannot be fetched is an error the first time;
  // later its keys stay, and the log says so. `withdrawn`: gains the hashes of the tokens that the file has no longer. `changed` is called,
  // by another thread, when the issuer's keys have changed by themselves.
  std::optional<Error> load(
      std::vector<std::string>* withdrawn = nullptr, const std::function<void()>& changed = [] {});
  // Refuses these until load().
  void withdraw(const std::vector<std::string>& hashes);
  bool requiresTokens() const { return !settings_.tokens.empty(); }

  // What the client is granted, or why it is refused. Without tokens: everything.
  std::variant<access::Grant, Answer> judge(const Request& request) const;

 private:
  static std::string hintOfPort(const Request& request);
  bool originMayAsk(std::string_view origin, std::string_view host) const;
  Answer refusalOf(std::string_view token, const Error& why) const;
  void take(std::vector<access::Key> issuers);
  void logUnknown(const std::vector<std::string>& rights) const;

  const Access settings_;
  const access::IssuerKeys::Fetch fetch_;
  mutable std::mutex mutex_;
  std::shared_ptr<const access::Tokens> tokens_;
  std::vector<access::Key> issuers_;                    // keys
  mutable std::set<std::string, std::less<>> unknown_;  // rights that the log has named, at most kMaxUnknown
  static constexpr std::size_t kMaxUnknown = 64;
  std::unique_ptr<access::IssuerKeys> remote_;  // last: its thread uses the others
};

// What a route requires; empty: nothing. Every path below /v1/ requires something.
struct Needed {
  std::optional<access::Right> right;
  bool everySession = false;  // shows more than one session
};
Needed needed(std::string_view method, std::string_view path);

}  // namespace ridgecast::http
