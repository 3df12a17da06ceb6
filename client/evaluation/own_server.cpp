#include "client/evaluation/own_server.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include "client/evaluation/text_file.h"

namespace ridgecast::evaluation {

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
  if (pid < 0) return Error{"no process for a server"};
  auto server = std::unique_ptr<OwnServer>(new OwnServer(pid));
  for (int k = 0; k < 3000; ++k) {
    if (int port = 0; std::ifstream(portFile) >> port) {
      server->port_ = static_cast<std::uint16_t>(port);
      return server;
    }
    int status = 0;
    if (waitpid(pid, &status, WNOHANG) == pid) {
      server->pid_ = -1;
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return Error{"the server did not start: " + readText(log).substr(0, 400)};
}

OwnServer::~OwnServer() {
  if (pid_ <= 0) return;
  kill(pid_, SIGTERM);
  for (int k = 0; k < 500; ++k) {
    if (waitpid(pid_, nullptr, WNOHANG) == pid_) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

}  // namespace ridgecast::evaluation
