// Whether snapshots slow the cameras of others: iterations a second of cameras that fly as fast as they are answered, with and without
// people who ask for one snapshot after the other, turn by turn on one server. Real sockets, all on this machine.
//
//   ridgecast-bench snapshot [--count N] [--askers N] [--seconds S] [--rounds N] [--budget TRIANGLES] [--share PERCENT]
//
// Each camera circles; as soon as a pose is answered it sends the next, 5 m on (50 m/s at ten iterations a second), so that all time the
// server takes from it is seen. The askers give way to everything: their machine would be another.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "common/terrain/terrain.h"
#include "server/snapshot/question.h"
#include "tests/bench/bench.h"
#include "tests/bench/line.h"
#include "tests/support/flight.h"
#include "tests/support/server_process.h"

namespace ridgecast::bench {
namespace {

struct Turns {
  std::vector<int> counts{1, 4};
  int askers = 2, rounds = 6, share = 10;
  double seconds = 3;
  std::uint32_t budget = 100'000;
};

// One snapshot after the other, of poses and boxes, plain and Draco, for as long as it lives.
class Asker {
 public:
  Asker(std::uint16_t port, int index, std::atomic<int>& answered)
      : thread_([this, port, index, &answered] {
          for (int k = index; !leaves_; ++k) answered += ask(port, k);
        }) {}
  ~Asker() {
    leaves_ = true;
    thread_.join();
  }
  Asker(const Asker&) = delete;
  Asker& operator=(const Asker&) = delete;

 private:
  bool ask(std::uint16_t port, int k) {
    const int x = 700 * (k % 11);
    const std::string request = "GET /v1/sessions/default/snapshot.glb?" +
                                (k % 2 ? "x0=" + std::to_string(x) + "&z0=0&x1=" + std::to_string(x + 3000) + "&z1=3000&error=0.5"
                                       : "x=" + std::to_string(x) + "&z=0&altitude=120&yaw=30&pitch=-10") +
                                (k % 4 < 2 ? "&compression=draco" : "") + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    bool good = ::connect(socket, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 &&
                ::send(socket, request.data(), request.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(request.size());
    std::string head;
    static thread_local char chunk[1 << 18];
    while (good) {
      if (leaves_) good = false;
      pollfd readable{socket, POLLIN, 0};
      if (::poll(&readable, 1, 20) == 0) continue;
      const auto n = ::recv(socket, chunk, sizeof chunk, 0);
      if (n <= 0) break;
      if (head.size() < 12) head.append(chunk, static_cast<std::size_t>(n));
    }
    ::close(socket);
    return good && head.starts_with("HTTP/1.1 200");
  }
  std::atomic<bool> leaves_{false};
  std::thread thread_;
};

// Cameras on circles of 400 m, 2 km apart.
class Flight {
 public:
  Flight(std::uint16_t port, int count, std::uint32_t budget, const terrain::Terrain& terrain) : terrain_(terrain), steps_(count, 0) {
    for (int k = 0; k < count; ++k) lines_.push_back(std::make_unique<Line>(port, "camera " + std::to_string(k), budget));
  }
  // Iterations a second of all together, over so many seconds.
  double fly(double seconds) {
    for (auto& line : lines_) line->restart();
    const Clock clock;
    while (clock.seconds() < seconds) turn();
    double iterations = 0;
    for (auto& line : lines_) iterations += static_cast<double>(line->iterations);
    return iterations / clock.seconds();
  }

 private:
  void turn() {
    std::vector<pollfd> ready;
    for (std::size_t k = 0; k < lines_.size(); ++k) {
      Line& line = *lines_[k];
      if (line.answered()) {
        const double a = 5.0 / 400 * steps_[k]++, x = 2000.0 * static_cast<double>(k);
        line.pose(testing_support::cameraAt(terrain_, x + 400 * std::cos(a), -400 * std::sin(a), 120, a, -0.15));
      }
      ready.push_back({line.socket(), POLLIN, 0});
    }
    ::poll(ready.data(), ready.size(), 20);
    for (std::size_t k = 0; k < lines_.size(); ++k)
      if (ready[k].revents) lines_[k]->receive();
  }
  const terrain::Terrain& terrain_;
  std::vector<int> steps_;
  std::vector<std::unique_ptr<Line>> lines_;
};

}  // namespace

Report snapshot(const Options& options) {
  Turns turns;
  for (std::size_t k = 0; k < options.arguments.size(); ++k) {
    const std::string& name = options.arguments[k];
    if (++k >= options.arguments.size()) throw std::runtime_error(name + " needs a value");
    const double value = std::atof(options.arguments[k].c_str());
    if (name == "--count")
      turns.counts = {std::clamp(static_cast<int>(value), 1, 32)};
    else if (name == "--askers")
      turns.askers = std::clamp(static_cast<int>(value), 1, 8);
    else if (name == "--seconds")
      turns.seconds = std::max(0.2, value);
    else if (name == "--rounds")
      turns.rounds = std::clamp(static_cast<int>(value), 1, 100);
    else if (name == "--share")
      turns.share = std::clamp(static_cast<int>(value), 1, 100);
    else if (name == "--budget")
      turns.budget = static_cast<std::uint32_t>(std::max(10'000.0, value));
    else
      throw std::runtime_error("snapshot does not know " + name);
  }
  if (options.quick) turns.seconds = 1, turns.rounds = 3;
  const auto terrain = terrain::create("alpine", 1);
  if (!terrain) throw std::runtime_error(terrain.error().message);
  Report report;
  double worst = 0;
  for (const int count : turns.counts) {
    testing_support::ServerProcess server(options.programFolder + "/ridgecast-server", {"--snapshot-share", std::to_string(turns.share)});
    Flight flight(server.port(), count, turns.budget, **terrain);
    flight.fly(options.quick ? 1 : 4);
    std::atomic<int> answered{0};
    std::vector<double> ratios, alone, beside;
    double before = flight.fly(turns.seconds);
    for (int round = 0; round < turns.rounds; ++round) {
      double busy = 0;
      {
        std::vector<std::unique_ptr<Asker>> askers;
        for (int k = 0; k < turns.askers; ++k) askers.push_back(std::make_unique<Asker>(server.port(), 2 * round + k, answered));
        flight.fly(0.2);
        busy = flight.fly(turns.seconds);
      }
      flight.fly(0.2);
      const double after = flight.fly(turns.seconds);  // the ground changes on the way: each turn is held against those around it
      ratios.push_back((before + after) / 2 / busy);
      alone.push_back(after);
      beside.push_back(busy);
      before = after;
    }
    const std::string of = "_" + std::to_string(count);
    report.add("iterations_per_second" + of, median(alone));
    report.add("iterations_per_second_asked" + of, median(beside));
    report.add("snapshots_per_second" + of, answered / (turns.rounds * (turns.seconds + 0.2)));
    report.add("slowdown" + of, median(ratios));
    worst = std::max(worst, median(ratios));
  }
  report.add("slowdown", worst);
  report.note("cameras that fly as fast as they are answered, budget " + std::to_string(turns.budget) + " triangles; " +
              std::to_string(turns.askers) + " askers, one snapshot after the other; " + std::to_string(turns.rounds) + " turns of " +
              std::to_string(std::lround(turns.seconds)) + " s with and without; " + std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) +
              " cores for all of them");
  return report;
}

}  // namespace ridgecast::bench
