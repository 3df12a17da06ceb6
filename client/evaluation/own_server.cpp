#include "client/evaluation/own_server.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/inotify.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <fstream>

#include "client/evaluation/text_file.h"

namespace ridgecast::evaluation {
namespace {

constexpr std::chrono::seconds kStartTime{30};
constexpr int kEndTime = 5000;  // ms

}  // namespace

Outcome<std::unique_ptr<OwnServer>> OwnServer::start(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                                                     const std::filesystem::path& folder) {
  if (access(program.c_str(), X_OK) != 0)
    return Error{"there is no program " + program.string() + ": build ridgecast-server, or name it with --server"};
  const std::filesystem::path portFile = folder / "port", log = folder / "server.log";
  std::error_code ignored;
  std::filesystem::remove(portFile, ignored);
  std::vector<std::string> all{program.string(), "--port", "0", "--port-file", portFile.string()};
  all.insert(all.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& a : all) argv.push_back(a.data());
  argv.push_back(nullptr);
  const int out = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (out < 0) return Error{"cannot write " + log.string()};
  const int renamed = inotify_init1(IN_CLOEXEC);
  inotify_add_watch(renamed, folder.c_str(), IN_MOVED_TO);
  const pid_t parent = getpid(), pid = fork();
  if (pid == 0) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(1);
    dup2(out, 1);
    dup2(out, 2);
    execv(argv[0], argv.data());
    _exit(127);
  }
  close(out);
  std::unique_ptr<OwnServer> server(pid < 0 ? nullptr : new OwnServer(pid, static_cast<int>(syscall(SYS_pidfd_open, pid, 0))));
  const auto until = std::chrono::steady_clock::now() + kStartTime;
  while (server && !(std::ifstream(portFile) >> server->port_)) {
    std::array<pollfd, 2> news{{{renamed, POLLIN, 0}, {server->end_, POLLIN, 0}}};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
    if (left.count() <= 0 || poll(news.data(), news.size(), static_cast<int>(left.count())) == 0 || news[1].revents != 0) break;
    std::array<char, 4096> events;
    if (read(renamed, events.data(), events.size()) < 0) break;
  }
  close(renamed);
  if (!server) return Error{"no process for a server"};
  if (server->port_ != 0) return server;
  return Error{"the server did not start: " + readText(log).substr(0, 400)};
}

OwnServer::~OwnServer() {
  kill(pid_, SIGTERM);
  pollfd end{end_, POLLIN, 0};
  if (poll(&end, 1, kEndTime) == 0) kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
  close(end_);
}

}  // namespace ridgecast::evaluation
