#pragma once
// Which client began each log of a folder, so that one client cannot take all names: an SQLite file beside the logs, for all servers on the
// folder. Logs that are older than it belong to nobody; those that are gone count no more.

#include <cstddef>
#include <memory>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/edit_log/lock.h"
#include "server/edit_log/log.h"

namespace ridgecast::edit_log {

inline constexpr char kClientsFile[] = "edits.clients";

// As Log::create, if the folder has fewer than `most` logs, of which this client began fewer than half. Waits while another is begun.
// Error: also one sentence that says which it has.
Outcome<std::unique_ptr<Log>> createFor(std::string_view client, std::shared_ptr<const Lock> lock, const World& world, std::size_t most);

}  // namespace ridgecast::edit_log
