#pragma once
// Records which client began each log in a folder, so that one client cannot take all names: an SQLite file beside the logs, for all
// servers on the folder. Logs older than it belong to no client; deleted logs no longer count.

#include <cstddef>
#include <memory>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/edit_log/lock.h"
#include "server/edit_log/log.h"

namespace ridgecast::edit_log {

inline constexpr char kClientsFile[] = "edits.clients";

// As Log::create, if the folder has fewer than `most` logs and this client began fewer than half of `most`. Waits while another log is
// begun. Error: also one sentence that names the limit reached.
Outcome<std::unique_ptr<Log>> createFor(std::string_view client, std::shared_ptr<const Lock> lock, const World& world, std::size_t most);

}  // namespace ridgecast::edit_log
