#pragma once
// Sessions that follow their terrain files (--watch): a file that was saved is loaded again, and a session of it gets a successor of the
// same name with the new ground; its members are told to connect again. A file that cannot be loaded changes
// nothing: the log and the members are told.

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "server/directory/directory.h"
#include "server/session/session.h"

namespace ridgecast {

class Watch {
 public:
  // Between two looks. A change is taken up once two looks saw the same: an editor may still be writing.
  static constexpr std::chrono::milliseconds kLook{250};

  // The files a world is made from.
  using FilesOf = std::function<std::vector<std::filesystem::path>(const session::WorldSpec&)>;
  // Sends the members of this session, which has a successor, away.
  using SendAway = std::function<void(const session::Session&)>;

  // Looks from now on, on a thread of its own, until destroyed.
  Watch(std::shared_ptr<directory::Directory> directory, FilesOf filesOf, session::MakeTerrain makeTerrain, SendAway sendAway);

 private:
  struct Version {
    std::filesystem::file_time_type time;
    std::uintmax_t size = 0;
    friend bool operator==(const Version&, const Version&) = default;
  };
  struct Seen {
    Version last;     // at the last look
    Version takenUp;  // of which the sessions are
  };
  bool look(const std::filesystem::path& file);  // whether it has changed
  void renew(const std::shared_ptr<session::Session>& session, const std::stop_token& stop);
  void run(const std::stop_token& stop);

  const std::shared_ptr<directory::Directory> directory_;
  const FilesOf filesOf_;
  const session::MakeTerrain makeTerrain_;
  const SendAway sendAway_;
  std::map<std::filesystem::path, Seen> files_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace ridgecast
