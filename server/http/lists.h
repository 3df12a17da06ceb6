#pragma once
// What there is, over HTTP: /v1/sessions lists the sessions, /v1/terrains the terrains for creating them.

#include <filesystem>
#include <optional>
#include <string>

#include "server/http/routes.h"

namespace ridgecast::http {

const char* nameOf(wire::ClockMode mode);

// A session of this server as it stands in the list: a JSON object.
std::string sessionEntry(const session::Session& session);
// {"sessions": [...], "max_sessions": N}, with those of other servers as of a second ago; then also {"servers": [...]}, and which of them
// have a session.
Answer sessionsAnswer(const directory::Directory& directory);

// GET /v1/terrains: {"terrains": [{"name", "summary", "parameters": [{"name", "default", "least", "most", "unit", "summary"}]}]}.
// The built-in terrains and the readable files of `folder`, read on each request by work. No folder: sessions cannot be created here, the
// list is empty.
Route terrainsRoute(std::optional<std::filesystem::path> folder);

}  // namespace ridgecast::http
