#include "tests/support/process.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace ridgecast::testing_support {

using namespace std::chrono_literals;

ScratchFolder::ScratchFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "ridgecast-test-XXXXXX").string();
  if (!mkdtemp(pattern.data())) throw std::runtime_error("cannot make a scratch folder " + pattern);
  path_ = pattern;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

Process::Process(const std::vector<std::string>& command, const Environment& environment) {
  // All that allocates is done before the fork: the child of a process with threads may do next to nothing.
  std::vector<std::string> variables;
  for (char** entry = environ; *entry; ++entry) {
    const std::string text = *entry, name = text.substr(0, text.find('='));
    if (std::none_of(environment.begin(), environment.end(), [&](const auto& e) { return e.first == name; })) variables.push_back(text);
  }
  for (const auto& [name, value] : environment)
    if (value) variables.push_back(name + "=" + *value);
  std::vector<char*> arguments, environmentPointers;
  for (const std::string& a : command) arguments.push_back(const_cast<char*>(a.c_str()));
  for (const std::string& v : variables) environmentPointers.push_back(const_cast<char*>(v.c_str()));
  arguments.push_back(nullptr);
  environmentPointers.push_back(nullptr);
  const std::string log = (folder_ / "output").string();
  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("cannot fork");
  if (pid_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setpgid(0, 0);  // what it starts itself can then be ended with it
    const int out = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), in = open("/dev/null", O_RDONLY);
    dup2(in, 0);
    dup2(out, 1);
    dup2(out, 2);
    execvpe(arguments[0], arguments.data(), environmentPointers.data());
    _exit(127);
  }
}

Process::~Process() {
  if (!running()) return;
  if (kill(-pid_, SIGKILL) != 0) kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

bool Process::running() { return !wait(0ms); }

std::optional<int> Process::wait(std::chrono::milliseconds timeout) {
  const auto until = std::chrono::steady_clock::now() + timeout;
  while (!status_) {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) == pid_) {
      status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    } else if (std::chrono::steady_clock::now() >= until) {
      break;
    } else {
      std::this_thread::sleep_for(5ms);
    }
  }
  return status_;
}

void Process::signal(int number) {
  if (running()) kill(pid_, number);
}

std::string Process::output() const { return readText(folder_ / "output"); }

Finished runProgram(const std::vector<std::string>& command, const Environment& environment, std::chrono::milliseconds timeout) {
  Process process(command, environment);
  const auto code = process.wait(timeout);
  return {code, process.output()};
}

bool programExists(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (access((folder + "/" + name).c_str(), X_OK) == 0) return true;
  return false;
}

std::string readText(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace ridgecast::testing_support
