#pragma once
// Sessions over HTTP: /v1/stream joins or creates one, /v1/sessions lists them, /v1/terrains says of which terrains they can be created.

#include <filesystem>
#include <optional>

#include "server/http/routes.h"

namespace ridgecast::http {

// The answer to the upgrade request: 101 with the session, or a refusal. A world that takes long to make is made by work (Answer::later),
// whose answer is then the upgrade. `directory` must outlive that work. A request without an upgrade, which tells a page why its WebSocket
// could not be opened, is judged in the same way: the same refusal, or 426 in place of 101, and no session is made.
Answer streamAnswer(const Request& request, session::Directory& directory);

// {"sessions": [...], "max_sessions": N}
Answer sessionsAnswer(const session::Directory& directory);

// GET /v1/terrains: {"terrains": [{"name", "summary", "parameters": [{"name", "default", "least", "most", "unit", "summary"}]}]}.
// The built-in terrains and the readable files of `folder`, read on each request by work. No folder: sessions cannot be created here, the
// list is empty.
Route terrainsRoute(std::optional<std::filesystem::path> folder);

}  // namespace ridgecast::http
