#pragma once
// The browser viewer over HTTP: its files with their types, compressed if the browser accepts that. The browser may keep a file for a year
// if its name holds a hash. A policy lets the page load its own files and contact its own server, nothing else.

#include <memory>

#include "server/http/routes.h"
#include "server/http/site.h"

namespace ridgecast::http {

// Answers GET and HEAD for the site's files and leaves everything else to other routes. Any thread.
Route pageRoute(std::shared_ptr<const Site> site);

}  // namespace ridgecast::http
