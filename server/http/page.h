#pragma once
// The browser viewer over HTTP: its files with their types, compressed where the browser takes that, kept by it for a year where their
// names hold a hash, and with a policy that lets the page load its own files and speak to its own server, nothing else.

#include <memory>

#include "server/http/routes.h"
#include "server/http/site.h"

namespace ridgecast::http {

// Answers GET and HEAD for the site's files; everything else is for others. Any thread.
Route pageRoute(std::shared_ptr<const Site> site);

}  // namespace ridgecast::http
