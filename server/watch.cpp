#include "server/watch.h"

#include <condition_variable>
#include <mutex>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "server/logging/logging.h"

namespace ridgecast {

Watch::Watch(std::shared_ptr<directory::Directory> directory, FilesOf filesOf, session::MakeTerrain makeTerrain, SendAway sendAway)
    : directory_(std::move(directory)),
      filesOf_(std::move(filesOf)),
      makeTerrain_(std::move(makeTerrain)),
      sendAway_(std::move(sendAway)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

void Watch::run(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any stopped;
  for (std::unique_lock lock(mutex); !stop.stop_requested(); stopped.wait_for(lock, stop, kLook, [] { return false; })) {
    std::set<std::filesystem::path> changed, looked;
    for (const auto& session : directory_->all()) {
      bool isOld = false;
      for (const std::filesystem::path& file : filesOf_(session->spec())) {
        if (looked.insert(file).second && look(file)) changed.insert(file);
        isOld = isOld || changed.contains(file);
      }
      if (isOld) renew(session, stop);
    }
    std::erase_if(files_, [&](const auto& entry) { return !looked.contains(entry.first); });
  }
}

bool Watch::look(const std::filesystem::path& file) {
  std::error_code gone;
  Version now;
  now.time = std::filesystem::last_write_time(file, gone);
  if (!gone && std::filesystem::is_regular_file(file, gone)) now.size = std::filesystem::file_size(file, gone);
  if (gone && files_.contains(file)) return false;  // an editor may be replacing it
  const auto [seen, isNew] = files_.try_emplace(file, Seen{now, now});
  const bool isQuiet = std::exchange(seen->second.last, now) == now;
  if (isNew || !isQuiet || seen->second.takenUp == now) return false;
  seen->second.takenUp = now;
  return true;
}

void Watch::renew(const std::shared_ptr<session::Session>& session, const std::stop_token& stop) {
  const logging::About about{.session = session->name(), .event = "ground"};
  auto terrain = makeTerrain_(session->spec(), stop);
  if (stop.stop_requested()) return;
  if (!terrain) {
    logging::error(about, "keeps its ground; the terrain file was saved with errors:");
    std::istringstream lines(terrain.error().message);
    for (std::string line; std::getline(lines, line);) logging::error(about, line);
    session->clock().tell("The terrain file was saved with errors; this is the ground from before. " + terrain.error().message);
    return;
  }
  if (terrain::contentHash(**terrain) == session->contentHash()) return;
  if (!directory_->replace(session, std::move(*terrain))) return;  // it has ended meanwhile
  logging::info(about, "has new ground; " + std::to_string(session->members()) + " members are told to connect again");
  sendAway_(*session);
}

}  // namespace ridgecast
