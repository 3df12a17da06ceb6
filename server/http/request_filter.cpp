#include "server/http/request_filter.h"

#include "common/text/text.h"
#include "server/access/host.h"
#include "server/directory/directory.h"
#include "server/logging/logging.h"

namespace ridgecast::http {

namespace {

constexpr std::string_view kSessions = "/v1/sessions/";

// The token among the offered subprotocols; empty: none.
std::string_view bearerOf(const Request& request) {
  constexpr std::string_view scheme = "Bearer ", prefix = "bearer.";
  if (request.authorization.size() > scheme.size() && access::sameIgnoringCase(request.authorization.substr(0, scheme.size()), scheme))
    return request.authorization.substr(scheme.size());
  for (std::string_view rest = request.subprotocols; !rest.empty();)
    if (const auto one = text::trimmed(text::takePart(rest, ',')); one.starts_with(prefix)) return one.substr(prefix.size());
  return {};
}

// Of /v1/sessions/NAME and what lies below.
std::optional<std::string_view> sessionOf(std::string_view path) {
  if (!path.starts_with(kSessions)) return std::nullopt;
  path.remove_prefix(kSessions.size());
  return path.substr(0, path.find('/'));
}

// What follows the session's name.
std::string_view belowSession(std::string_view path) {
  const auto session = sessionOf(path);
  return session ? std::string_view(session->data() + session->size(), path.data() + path.size()) : std::string_view();
}

bool isOfTileset(std::string_view path) { return belowSession(path).starts_with("/3dtiles/"); }
bool isOfEdits(std::string_view path) { return belowSession(path) == "/edits" || belowSession(path).starts_with("/edits/"); }

Answer unauthorised(std::string sentence, const std::string& error = {}) {
  return refused(401, metrics::Refusal::kToken, std::move(sentence), {{"WWW-Authenticate", R"(Bearer realm="ridgecast")" + error}});
}

// No line is left out: they are as many as the operator withdraws.
void audit(const access::Tokens& tokens, const std::vector<std::string>& hashes, const std::string& why) {
  for (const std::string& hash : hashes)
    if (const auto holder = tokens.holderOf(hash))
      logging::info({.holder = *holder, .event = "withdrawn"},
                    "the token of " + *holder + " (sha256:" + hash.substr(0, 12) + "...) was withdrawn: " + why);
}

}  // namespace

Needed needed(std::string_view method, std::string_view path) {
  using access::Right;
  if (path == "/metrics") return {Right::kView, true};
  if (!path.starts_with("/v1/")) return {};
  if (path == "/v1/sessions") return {method == "GET" || method == "HEAD" ? Right::kView : Right::kCreate, true};
  if (isOfEdits(path)) return {method == "GET" || method == "HEAD" ? Right::kView : Right::kEdit};
  if (sessionOf(path) && (method == "DELETE" || belowSession(path) == "/backup")) return {Right::kAdmin};
  if (const auto session = sessionOf(path)) {
    if (method == "OPTIONS") return {};
    const std::string_view file = path.substr(kSessions.size() + session->size());
    const bool isTile = file.starts_with("/heights/") || file.starts_with("/colours/");
    return {isTile                                                                        ? Right::kQuery
            : path.substr(path.rfind('/')).starts_with("/snapshot.") || isOfTileset(path) ? Right::kSnapshot
                                                                                          : Right::kView};
  }
  for (const std::string_view query : {"/v1/heights", "/v1/normals", "/v1/materials", "/v1/rays", "/v1/query"})
    if (path.starts_with(query)) return {Right::kQuery};
  return {Right::kView};
}

std::optional<Error> RequestFilter::load(std::vector<std::string>* withdrawn, const std::function<void()>& changed) {
  if (!requiresTokens()) return {};
  auto tokens = access::Tokens::load(settings_.tokens);
  if (!tokens) return tokens.error();
  const auto failed = [](const Error& e) { logging::error("the keys of the tokens' issuer stay as they were: " + e.message); };
  std::optional<Outcome<std::vector<access::Key>>> fetched;
  if (!settings_.tokens.keyUrl.empty()) {
    const bool isFirst = !remote_;
    if (isFirst) {
      const auto take = [this, changed](std::vector<access::Key> keys) {
        this->take(std::move(keys));
        changed();
      };
      remote_ = std::make_unique<access::IssuerKeys>(fetch_, take, failed);
    }
    fetched = remote_->fetch();
    if (!*fetched && isFirst) {
      remote_.reset();
      return fetched->error();
    }
    if (!*fetched) failed(fetched->error());
  }
  const std::lock_guard lock(mutex_);
  if (withdrawn && tokens_) {
    *withdrawn = tokens_->missingFrom(**tokens);
    audit(*tokens_, *withdrawn, "it is no longer in '" + settings_.tokens.tokens.string() + "'");
  }
  if (fetched && *fetched) issuers_ = std::move(**fetched);
  tokens_ = (*tokens)->with(issuers_);
  return {};
}

void RequestFilter::withdraw(const std::vector<std::string>& hashes) {
  const std::lock_guard lock(mutex_);
  if (!tokens_) return;
  audit(*tokens_, hashes, "at another server");
  tokens_ = tokens_->without(hashes);
}

void RequestFilter::take(std::vector<access::Key> issuers) {
  const std::lock_guard lock(mutex_);
  issuers_ = std::move(issuers);
  if (tokens_) tokens_ = tokens_->with(issuers_);
}

Answer RequestFilter::refusalOf(std::string_view token, const Error& why) const {
  if (remote_ && remote_->mayKnowSoon(token))
    return refused(503, metrics::Refusal::kToken, "The token names a key that is being fetched; ask again in a moment.",
                   {{"Retry-After", "1"}});
  return unauthorised(why.message, R"(, error="invalid_token")");
}

void RequestFilter::logUnknown(const std::vector<std::string>& rights) const {
  for (const std::string& right : rights) {
    const std::lock_guard lock(mutex_);
    if (unknown_.size() < kMaxUnknown && unknown_.insert(right).second)
      logging::info("ignores the right '" + right + "' of a token, which is unknown here");
  }
}

// Whether this is the server's own page or an allowed one. access/host.h has already checked the server's name.
bool RequestFilter::originMayAsk(std::string_view origin, std::string_view host) const {
  for (const std::string& allowed : settings_.allowedOrigins)
    if (allowed == "*" || access::sameIgnoringCase(allowed, origin)) return true;
  const auto scheme = origin.find("://");
  return scheme != std::string_view::npos && !host.empty() && access::sameIgnoringCase(origin.substr(scheme + 3), host);
}

// The page's own server, but for the port that a proxy has cut off, as nginx does by $host.
std::string RequestFilter::hintOfPort(const Request& request) {
  const std::size_t name = request.origin.find("://");
  if (name == std::string_view::npos || access::hostName(request.host) != request.host ||
      !access::sameIgnoringCase(access::hostName(request.origin.substr(name + 3)), request.host))
    return {};
  return " If it is this server's own page, the proxy in between must pass on the port in the header Host, as nginx does by "
         "proxy_set_header Host $http_host.";
}

std::variant<access::Grant, Answer> RequestFilter::judge(const Request& request) const {
  const std::string_view path = request.path();
  const Needed need = needed(request.method, path);
  if (!requiresTokens() && path != "/healthz" && path != "/readyz" &&
      !access::answersTo(request.host, settings_.host, settings_.allowedHosts))
    return refused(421, metrics::Refusal::kHost,
                   "This server does not answer to that name, which may not be its own; use its address or localhost, or its operator can "
                   "allow the name with --allowed-host.");
  if (!request.origin.empty() && need.right && !originMayAsk(request.origin, request.host))
    return refused(403, metrics::Refusal::kOrigin,
                   "Pages of this origin may not use this server; its operator can allow them with --allow-origin." + hintOfPort(request));
  // A page's <img> or link sends no Origin.
  if (request.origin.empty() && request.fetchSite == "cross-site" && need.right)
    return refused(403, metrics::Refusal::kOrigin, "Pages of other sites may not start work here; open the address itself.");
  if (!requiresTokens()) return access::Grant{{}, access::Rights::all(), {}, {}};
  if (!need.right) return access::Grant{};

  std::string bearer(bearerOf(request));
  const bool fromUrl = bearer.empty() && isOfTileset(path);
  if (fromUrl)
    if (auto token = queryParameter(request.query(), "token")) bearer = std::move(*token);
  if (bearer.empty()) return unauthorised("This needs a token: Authorization: Bearer TOKEN.");
  const auto now = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
  std::shared_ptr<const access::Tokens> tokens;
  {
    const std::lock_guard lock(mutex_);
    tokens = tokens_;
  }
  auto grant = tokens->judge(bearer, now);
  if (!grant) return refusalOf(bearer, grant.error());
  logUnknown(grant->unknown);
  if (fromUrl && (!grant->expires || *grant->expires - now > kLongestInUrl + settings_.tokens.jwt.leeway))
    return unauthorised("A token in a URL must expire within a day; 'ridgecast-server token --expires 1h' makes one.",
                        R"(, error="invalid_token")");
  const auto forbidden = [&](std::string sentence) {
    Answer a = refused(403, metrics::Refusal::kRight, std::move(sentence),
                       {{"WWW-Authenticate", R"(Bearer realm="ridgecast", error="insufficient_scope")"}});
    a.holder = grant->name;
    return a;
  };
  if (!grant->rights.has(*need.right)) return forbidden("The token lacks the right '" + std::string(name(*need.right)) + "'.");
  if (need.everySession && !grant->session.empty()) return forbidden("The token is for session '" + grant->session + "' alone.");
  const auto reaches = [&] {
    if (need.everySession) return true;
    if (const auto session = sessionOf(path)) return grant->reaches(*session);
    const auto session = queryParameter(request.query(), "session");
    if (!session) return grant->session.empty();
    return grant->reaches(session->empty() ? directory::kDefaultName : std::string_view(*session));
  };
  if (!reaches()) return forbidden("The token is for another session.");
  return access::Grant(std::move(*grant));
}

}  // namespace ridgecast::http
