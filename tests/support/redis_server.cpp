#include "tests/support/redis_server.h"

#include <csignal>
#include <stdexcept>
#include <utility>

#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

RedisServer::RedisServer(std::vector<std::string> arguments) : arguments_(std::move(arguments)), port_(freePort()) { start(); }

void RedisServer::start() {
  std::vector<std::string> words{"redis-server", "--port", std::to_string(port_), "--bind", "127.0.0.1", "--dir", folder().string(),
                                 "--appendonly", "yes",    "--appendfsync",       "always", "--save",    ""};
  for (const std::string& argument : arguments_) {
    const bool isFile = &argument == &arguments_.front() && !argument.starts_with("-");
    words.insert(isFile ? words.begin() + 1 : words.end(), argument == "PORT" ? std::to_string(port_) : argument);
  }
  const bool started = await(
      [&] {
        process_.emplace(words);
        return await([&] { return !process_->running() || output().find("Ready to accept connections") != std::string::npos; }) &&
               process_->running();
      },
      std::chrono::seconds(10));  // its port may be another's for a moment
  if (!started) throw std::runtime_error("redis-server does not start: " + output());
}

void RedisServer::kill() {
  process_->signal(SIGKILL);
  process_->wait(kTimeout);
}
void RedisServer::pause() { process_->signal(SIGSTOP); }
void RedisServer::resume() { process_->signal(SIGCONT); }
bool RedisServer::isRunning() { return process_->running(); }

std::string RedisServer::command(const std::vector<std::string>& words) const {
  std::vector<std::string> all{"redis-cli", "-p", std::to_string(port_)};
  all.insert(all.end(), words.begin(), words.end());
  return runProgram(all).output;
}

void RedisServer::listenAt(std::uint16_t port) {
  const bool listens = await([&] { return command({"CONFIG", "SET", "port", std::to_string(port)}).starts_with("OK"); });
  if (!listens) throw std::runtime_error("redis-server does not listen at another port");
  port_ = port;
}

}  // namespace ridgecast::testing_support
