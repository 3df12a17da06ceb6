#pragma once
// Edits of a session's ground over HTTP, for scripts and people:
//   POST   /v1/sessions/NAME/edits            an operation as JSON (common/edits/json.h); 201 {"number": N}
//   DELETE /v1/sessions/NAME/edits/N          undoes edit N; 201 {"number": N of the undo}
//   GET    /v1/sessions/NAME/edits?since=N    {"last": N, "edits": [{"number", "author", "name", "edit": {...}}, ...]}; &limit=M
//   GET    /v1/sessions/NAME/backup           the log's file as of now, for a server's folder of state; needs the right `admin`
// On a map that says where it lies, an edit may name its places by "crs", as queries do.
// A 201 means that the edit has its number, is stored and is in everybody's ground. One that the same client repeats with the same header
// Idempotency-Key is made once. Edits need the right `edit`; the list (at most kMaxListed and kMaxListedBytes, at least one) needs `view`.
// 400 and 422: one sentence; 429, with Retry-After, and 507, for lack of room: nothing was made.

#include <cstddef>
#include <memory>

#include "server/directory/directory.h"
#include "server/http/routes.h"

namespace ridgecast::http {

inline constexpr std::size_t kMaxListed = 1000, kUsuallyListed = 256;
inline constexpr std::size_t kMaxListedBytes = std::size_t{256} << 10;
inline constexpr std::size_t kMaxEditBytes = std::size_t{2} << 20;  // of a POST: a stamp of 256 x 256 samples

inline constexpr std::size_t kMaxBackupBytes = std::size_t{512} << 20;

Route editsRoute(std::shared_ptr<directory::Directory> directory);

}  // namespace ridgecast::http
