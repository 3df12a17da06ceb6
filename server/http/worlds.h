#pragma once
// Sessions over HTTP: /v1/stream and queries join or create one.

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "server/earth/earth.h"
#include "server/http/routes.h"

namespace ridgecast::http {

// What to do with the session.
using Enter = std::function<Reply(std::shared_ptr<session::Session>)>;

// Enters the session that the URL names, makes it as the URL says, or refuses. `enter` is called once the session has the edit that the
// answer must include (onceHas). A world that takes long to make is made by work, whose reply is then that of `enter`. `directory` must
// outlive that work. `makes` false: the same checks, but no session is made, and `enter` gets null instead of a new one.
Reply inSession(const Request& request, directory::Directory& directory, const Enter& enter, bool makes = true);

// With a bus: the session that a path below /v1/sessions/NAME names, if it is not on this server. Otherwise none.
std::optional<std::string> missingHere(const Request& request, const directory::Directory& directory);
// Makes that session here, if other servers have it, then `enter`; otherwise noSession().
Reply fromElsewhere(const std::string& name, const Request& request, directory::Directory& directory, const Enter& enter);

// With a bus: makes here, one after another, the sessions that live on other servers and whose edits this one has kept, and reads
// what was made since of all that are here, so that no client waits for that. RetryAt until it is done, or 10 seconds have passed; made
// before the directory joins the others. `directory` must outlive it.
std::function<Reply(const Turn&)> takingUp(directory::Directory& directory);

// Places on a session's map in people's coordinates; a private one does not say where it lies. PROJ is slow: call from work. Error:
// Coordinates::of.
Outcome<earth::Coordinates> coordinatesOf(const session::Session& session, std::string_view crs);

// The answer to the upgrade request: 101 with the session, or a refusal, as inSession(). A request without an upgrade, which tells a page
// why its WebSocket could not be opened, gets the same refusal, or 426 in place of 101, and no session is made.
Reply streamAnswer(const Request& request, directory::Directory& directory);

}  // namespace ridgecast::http
