#include "common/process/child.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <thread>

#include "common/outcome/contract.h"

namespace ridgecast::process {
namespace {

using Clock = std::chrono::steady_clock;

void limit(int resource, std::uint64_t most) {
  rlimit value;
  if (getrlimit(static_cast<__rlimit_resource_t>(resource), &value) != 0) return;
  value.rlim_cur = std::min<rlim_t>(most, value.rlim_max);
  setrlimit(static_cast<__rlimit_resource_t>(resource), &value);
}

std::vector<char*> pointersTo(std::vector<std::string>& words) {
  std::vector<char*> out;
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

// Runs in the parent's memory until execve, see start(): only system calls, nothing is allocated or kept.
[[noreturn]] void become(char* const* argv, char* const* environment, int output, const ChildLimits& limits, int rules) {
  setpgid(0, 0);
  dup2(open("/dev/null", O_RDONLY), 0);
  dup2(output, 1);
  dup2(output, 2);
  // The child must not inherit the server's sockets: a client would wait for a dead server while one stays open here.
  close_range(3, ~0u, CLOSE_RANGE_CLOEXEC);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  limit(RLIMIT_AS, limits.memory);
  limit(RLIMIT_FSIZE, limits.fileSize);
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_CPU, static_cast<std::uint64_t>(limits.time.count()));
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  if (rules < 0 || ReachRules::enter(rules)) execve(argv[0], argv, environment);
  _exit(127);
}

// The child's process, -1: errno says why there is none. By vfork, as posix_spawn does, for fork copies the page tables of a server of many
// GiB, while its threads wait, and then every page that they write. posix_spawn itself cannot set limits, and limits that the parent sets
// afterwards come too late for what a compiler driver has started. No signal may be handled in the shared memory.
pid_t start(char* const* argv, char* const* environment, int output, const ChildLimits& limits, int rules) {
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t child = vfork();
  if (child == 0) become(argv, environment, output, limits, rules);
  const int error = errno;
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  errno = error;
  return child;
}

// Until the end of the output; false where time is up or a stop is requested first.
bool readAll(int from, Clock::time_point until, const std::stop_token& stop, std::string& output) {
  char buffer[4096];
  for (;;) {
    if (stop.stop_requested() || Clock::now() >= until) return false;
    pollfd wait{from, POLLIN, 0};
    if (poll(&wait, 1, static_cast<int>(kLook.count())) <= 0) continue;
    const ssize_t n = read(from, buffer, sizeof buffer);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return true;
    output.append(buffer, std::min(static_cast<std::size_t>(n), kMaxOutput - output.size()));
  }
}

}  // namespace

std::optional<std::filesystem::path> findProgram(const std::string& name) {
  expects(!name.empty() && name.find('/') == std::string::npos, "a program is looked for by its name alone");
  const char* path = std::getenv("PATH");
  std::string_view folders = path ? path : "/usr/bin:/bin";
  while (!folders.empty()) {
    const std::size_t end = std::min(folders.find(':'), folders.size());
    const std::filesystem::path file = std::filesystem::path(folders.substr(0, end)) / name;
    if (end > 0 && access(file.c_str(), X_OK) == 0) return file;
    folders.remove_prefix(std::min(end + 1, folders.size()));
  }
  return std::nullopt;
}

Outcome<ChildEnd> runChild(const std::filesystem::path& program, const std::vector<std::string>& arguments, const ChildLimits& limits,
                           std::stop_token stop) {
  expects(limits.time.count() > 0, "a child program has time");
  const auto stopped = [&] { return Error{program.string() + " was stopped: nobody waits for it any more"}; };
  if (stop.stop_requested()) return stopped();
  const auto cannot = [&] { return Error{"cannot start " + program.string() + ": " + std::strerror(errno)}; };
  std::optional<ReachRules> rules;
  if (limits.reach) {
    auto made = ReachRules::of(*limits.reach);
    if (!made) return Error{"cannot start " + program.string() + ": " + made.error().message};
    rules.emplace(std::move(*made));
  }
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return cannot();
  std::vector<std::string> words{program.string()};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<std::string> environment{"LC_ALL=C", "TMPDIR=" + std::filesystem::temp_directory_path().string()};
  if (const char* path = std::getenv("PATH")) environment.push_back(std::string("PATH=") + path);
  const auto argv = pointersTo(words), envp = pointersTo(environment);

  const pid_t child = start(argv.data(), envp.data(), ends[1], limits, rules ? rules->descriptor() : -1);
  if (child < 0) {
    const Error error = cannot();
    close(ends[0]), close(ends[1]);
    return error;
  }
  setpgid(child, child);  // for sanitizers, whose vfork is fork: whichever comes first
  close(ends[1]);

  ChildEnd out;
  const auto until = Clock::now() + kMaxWaiting * limits.time;
  bool isOver = !readAll(ends[0], until, stop, out.output);
  close(ends[0]);
  // The output may end before the child does. Wait without reaping, so that nobody else gets its group's number.
  for (;;) {
    isOver = isOver || stop.stop_requested() || Clock::now() >= until;
    if (isOver) kill(-child, SIGKILL);
    siginfo_t ended{};
    if (waitid(P_PID, static_cast<id_t>(child), &ended, WEXITED | WNOWAIT | (isOver ? 0 : WNOHANG)) == 0 && ended.si_pid == child) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  kill(-child, SIGKILL);  // anything it has left behind
  int status = 0;
  waitpid(child, &status, 0);
  if (stop.stop_requested()) return stopped();
  if (WIFEXITED(status)) out.status = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) out.signal = WTERMSIG(status);
  out.timedOut = isOver || out.signal == SIGXCPU;
  if (out.status == 127 && out.output.empty()) return Error{"cannot start " + program.string()};
  return out;
}

}  // namespace ridgecast::process
