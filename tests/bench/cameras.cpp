// Many cameras on one server: real sockets to a real server process, all on this machine, load generator included.
//
//   ridgecast-bench cameras [--count N] [--seconds S] [--budget TRIANGLES] [--rest] [--threads N] [--bytes-per-second N] [--table] [--plot
//                           FILE.svg]
//
// Each camera flies straight on at 50 m/s, 120 m above the ground, on a line of its own, and sends ten poses a second; --rest: it stands
// still. The generator is one thread that parses what comes and acknowledges with the hash it was told; tests elsewhere hold the mesh.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/terrain/terrain.h"
#include "common/wire/wire.h"
#include "tests/bench/bench.h"
#include "tests/bench/flight.h"
#include "tests/bench/panels.h"
#include "tests/support/server_process.h"

namespace ridgecast::bench {
namespace {

using Time = std::chrono::steady_clock;
double since(Time::time_point t) { return std::chrono::duration<double>(Time::now() - t).count(); }

struct Plan {
  int count = 32;
  double seconds = 20, warmUp = 8;
  std::uint32_t budget = 100'000;
  std::uint64_t bytesPerSecond = 0;
  double interval = 0.1;
  bool rest = false, table = false;
  std::string plot;  // file
  std::vector<std::string> server;
};

// One camera's end of the line.
class Line {
 public:
  Line(std::uint16_t port, int index, const Plan& plan, const terrain::Terrain& terrain)
      : index_(index), plan_(plan), terrain_(terrain), opened_(Time::now()) {
    socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
      throw std::runtime_error("cannot connect to the server");
    const int one = 1;
    setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    write(
        "GET /v1/stream HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: "
        "13\r\nSec-WebSocket-Key: "
        "dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
  }
  ~Line() { ::close(socket_); }
  Line(const Line&) = delete;

  int socket() const { return socket_; }

  void pose() {
    if (!upgraded_) return;
    const double t = plan_.rest ? 0 : since(opened_);
    // Lines a kilometre apart, each camera in its own direction.
    const double yaw = index_ * 2.399963, x = 1000.0 * (index_ % 8) - 50 * t * std::sin(yaw),
                 z = 1000.0 * (index_ / 8) - 50 * t * std::cos(yaw);
    wire::PoseMessage p;
    p.sequence = ++sequence_;
    p.camera = cameraAt(terrain_, x, z, 120, yaw, -0.15);
    waiting_.push_back({sequence_, Time::now()});
    message(p);
  }

  // Reads what is there.
  void receive() {
    char chunk[65536];
    for (;;) {
      const auto n = ::recv(socket_, chunk, sizeof chunk, MSG_DONTWAIT);
      if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) break;
      if (n <= 0) throw std::runtime_error("the server hung up on camera " + std::to_string(index_));
      in_.append(chunk, static_cast<std::size_t>(n));
      if (static_cast<std::size_t>(n) < sizeof chunk) break;
    }
    if (!upgraded_) {
      const auto end = in_.find("\r\n\r\n");
      if (end == std::string::npos) return;
      if (in_.compare(0, 12, "HTTP/1.1 101") != 0) throw std::runtime_error("refused: " + in_.substr(0, 200));
      in_.erase(0, end + 4);
      upgraded_ = true;
      wire::Hello hello;
      hello.clientName = "bench";
      hello.settings.triangleBudget = plan_.budget;
      hello.settings.bytesPerSecond = plan_.bytesPerSecond;
      message(hello);
      pose();
    }
    std::size_t at = 0;
    for (;;) {
      const auto byte = [&](std::size_t k) { return static_cast<std::uint64_t>(static_cast<unsigned char>(in_[at + k])); };
      if (in_.size() - at < 2) break;
      std::size_t head = 2;
      std::uint64_t length = byte(1) & 127;
      const std::size_t extra = length == 126 ? 2 : length == 127 ? 8 : 0;
      if (in_.size() - at < 2 + extra) break;
      if (extra) {
        length = 0;
        for (std::size_t k = 0; k < extra; ++k) length = length << 8 | byte(2 + k);
      }
      head += extra;
      if (in_.size() - at < head + length) break;
      const auto opcode = byte(0) & 15;
      if (opcode == 2) take({reinterpret_cast<const std::uint8_t*>(in_.data()) + at + head, length});
      if (opcode == 9) frame(10, in_.substr(at + head, length));
      if (opcode == 8)
        throw std::runtime_error("the server closed camera " + std::to_string(index_) + ": " + in_.substr(at + head + 2, length - 2));
      at += head + length;
    }
    in_.erase(0, at);
  }

  void restart() {
    iterations = 0;
    bytes = 0;
    latencies.clear();
    encodeMs = totalMs = 0;
  }

  std::uint64_t iterations = 0, bytes = 0;
  double encodeMs = 0, totalMs = 0, coarseMs = 0;
  std::vector<double> latencies;  // ms
  bool settled = false;

 private:
  void take(std::span<const std::uint8_t> payload) {
    const auto message = wire::decodeServer(payload);
    if (!message) throw std::runtime_error(message.error().message);
    if (const auto* error = std::get_if<wire::ErrorMessage>(&*message)) throw std::runtime_error(error->message);
    const auto* it = std::get_if<wire::Iteration>(&*message);
    if (!it) return;
    if (coarseMs == 0) coarseMs = since(opened_) * 1e3;
    ++iterations;
    bytes += payload.size();
    const wire::Figures& f = it->figures;
    encodeMs += f.encodeMs;
    totalMs += f.selectMs + f.generateMs + f.refineMs + f.triangulateMs + f.encodeMs;
    settled = it->settled;
    while (!waiting_.empty() && waiting_.front().first <= it->poseSequence) {
      latencies.push_back(since(waiting_.front().second) * 1e3);
      waiting_.pop_front();
    }
    this->message(wire::Acknowledge{it->number, it->meshHash});
  }

  void message(const wire::ClientMessage& m) { frame(2, wire::encode(m)); }
  void frame(int opcode, const std::string& payload) {
    std::string out(1, static_cast<char>(0x80 | opcode));
    if (payload.size() < 126) {
      out += static_cast<char>(0x80 | payload.size());
    } else {
      out += static_cast<char>(0x80 | 126);
      out += static_cast<char>(payload.size() >> 8);
      out += static_cast<char>(payload.size());
    }
    out.append(4, '\0');  // the mask
    write(out + payload);
  }
  void write(std::string_view out) {
    while (!out.empty()) {
      const auto n = ::send(socket_, out.data(), out.size(), MSG_NOSIGNAL);
      if (n <= 0) throw std::runtime_error("the server hung up");
      out.remove_prefix(static_cast<std::size_t>(n));
    }
  }

  const int index_;
  const Plan& plan_;
  const terrain::Terrain& terrain_;
  const Time::time_point opened_;
  int socket_ = -1;
  bool upgraded_ = false;
  std::string in_;
  std::uint64_t sequence_ = 0;
  std::deque<std::pair<std::uint64_t, Time::time_point>> waiting_;
};

struct Use {
  double cpuSeconds = 0, mib = 0;
};
Use useOf(pid_t pid) {
  Use use;
  std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
  std::string text((std::istreambuf_iterator<char>(stat)), {});
  std::istringstream fields(text.substr(text.rfind(')') + 2));
  std::string skip;
  for (int k = 0; k < 11; ++k) fields >> skip;
  double user = 0, system = 0;
  fields >> user >> system;
  use.cpuSeconds = (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
  std::ifstream statm("/proc/" + std::to_string(pid) + "/statm");
  double total = 0, resident = 0;
  statm >> total >> resident;
  use.mib = resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
  return use;
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

Report measure(const Plan& plan, const Options& options) {
  const auto terrain = terrain::create("alpine", 1);
  if (!terrain) throw std::runtime_error(terrain.error().message);
  const std::string many = std::to_string(plan.count + 8);
  std::vector<std::string> arguments{
      "--max-cameras", many, "--max-members", many, "--max-connections", many, "--max-connections-per-address", many};
  arguments.insert(arguments.end(), plan.server.begin(), plan.server.end());
  testing_support::ServerProcess server(options.programFolder + "/ridgecast-server", arguments);
  const pid_t pid = server.process().id();

  const int poll = ::epoll_create1(0);
  std::vector<std::unique_ptr<Line>> lines;
  std::vector<Time::time_point> next;
  double measuredFrom = 0, serverCpu = 0, ownCpu = 0;
  bool measuring = false;
  const auto began = Time::now();
  // Cameras join one after the other, all within two seconds (a hundred a second at rest).
  const double joining = plan.rest ? plan.count / 100.0 : std::min(2.0, 0.05 * plan.count), warm = joining + plan.warmUp;
  for (;;) {
    const double now = since(began);
    if (!measuring && now >= warm) {
      measuring = true;
      measuredFrom = now;
      serverCpu = useOf(pid).cpuSeconds;
      ownCpu = cpuSeconds();
      for (auto& line : lines) line->restart();
    }
    if (measuring && now - measuredFrom >= plan.seconds) break;
    while (static_cast<int>(lines.size()) < plan.count && now >= joining * static_cast<double>(lines.size()) / plan.count) {
      const int k = static_cast<int>(lines.size());
      lines.push_back(std::make_unique<Line>(server.port(), k, plan, **terrain));
      next.push_back(Time::now() +
                     std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(plan.interval * (1 + (k % 16) / 16.0))));
      epoll_event event{};
      event.events = EPOLLIN;
      event.data.u32 = static_cast<std::uint32_t>(k);
      ::epoll_ctl(poll, EPOLL_CTL_ADD, lines.back()->socket(), &event);
    }
    if (!plan.rest)
      for (std::size_t k = 0; k < lines.size(); ++k)
        if (Time::now() >= next[k]) {
          next[k] += std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(plan.interval));
          lines[k]->pose();
        }
    epoll_event events[64];
    const int n = ::epoll_wait(poll, events, 64, 1);
    for (int k = 0; k < n; ++k) lines[events[k].data.u32]->receive();
  }
  const double seconds = since(began) - measuredFrom;
  const Use use = useOf(pid);
  ::close(poll);

  Report report;
  std::vector<double> rates, latencies, bytes, coarse;
  double sum = 0, squares = 0, encode = 0, total = 0, settled = 0;
  for (const auto& line : lines) {
    const double rate = static_cast<double>(line->iterations) / seconds;
    rates.push_back(rate);
    sum += rate;
    squares += rate * rate;
    latencies.insert(latencies.end(), line->latencies.begin(), line->latencies.end());
    bytes.push_back(static_cast<double>(line->bytes) / seconds);
    coarse.push_back(line->coarseMs);
    encode += line->encodeMs;
    total += line->totalMs;
    settled += line->settled;
  }
  report.add("cameras", plan.count);
  report.add("iterations_per_second", *std::min_element(rates.begin(), rates.end()));
  report.add("median_iterations_per_second", median(rates));
  report.add("p50_ms", percentile(latencies, 0.5), "ms");
  report.add("p99_ms", percentile(latencies, 0.99), "ms");
  report.add("fairness", squares > 0 ? sum * sum / (static_cast<double>(rates.size()) * squares) : 1);
  report.add("server_rss_mib", use.mib, "MiB");
  report.add("server_cores", (use.cpuSeconds - serverCpu) / seconds);
  report.add("generator_cores", (cpuSeconds() - ownCpu) / seconds);
  report.add("bytes_per_second", median(bytes), "B/s");
  report.add("encode_share", total > 0 ? encode / total : 0);
  report.add("first_view_ms", median(coarse), "ms");
  if (plan.rest) report.add("at_rest", settled);
  report.note(std::to_string(plan.count) + (plan.rest ? " cameras at rest" : " cameras at 50 m/s, ten poses a second each") + ", budget " +
              std::to_string(plan.budget) + " triangles, " + std::to_string(static_cast<int>(seconds + 0.5)) + " s, after " +
              std::to_string(static_cast<int>(warm + 0.5)) + " s; " + std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) +
              " cores for server and generator");
  return report;
}

// The curve over the number of cameras, as rows of a Markdown table, and drawn.
Report curve(const Plan& plan, const Options& options) {
  Report last;
  std::vector<double> counts;
  std::map<std::string, std::vector<double>> figures;
  std::printf(
      "| cameras | iterations/s slowest | median | p50 ms | p99 ms | fairness | B/s each | encoding | server MiB | server cores "
      "|\n|---|---|---|---|---|---|---|---|---|---|\n");
  for (int count = 1; count <= plan.count; count *= 2) {
    Plan one = plan;
    one.count = count;
    last = measure(one, options);
    counts.push_back(count);
    for (const Figure& f : last.figures) figures[f.name].push_back(f.value);
    const auto of = [&](const char* name) { return figures.at(name).back(); };
    std::printf("| %d | %.1f | %.1f | %.0f | %.0f | %.3f | %.0f | %.0f %% | %.0f | %.2f |\n", count, of("iterations_per_second"),
                of("median_iterations_per_second"), of("p50_ms"), of("p99_ms"), of("fairness"), of("bytes_per_second"),
                100 * of("encode_share"), of("server_rss_mib"), of("server_cores"));
    std::fflush(stdout);
  }
  if (plan.plot.empty()) return last;
  const std::vector<Panel> panels{
      {"Iterations a second",
       {{"slowest camera", figures["iterations_per_second"]}, {"median", figures["median_iterations_per_second"]}},
       true,
       10,
       "ten poses a second"},
      {"From pose to mesh, ms", {{"p50", figures["p50_ms"]}, {"p99", figures["p99_ms"]}}, true, 150, "150 ms"},
      {"Bytes a second, each camera", {{"", figures["bytes_per_second"]}}, false, 0, ""},
      {"The server's processor time, cores", {{"", figures["server_cores"]}}, false, 0, ""},
      {"The server's memory, MiB", {{"", figures["server_rss_mib"]}}, false, 0, ""},
      {"From connection to the first full view, ms", {{"", figures["first_view_ms"]}}, false, 200, "200 ms"}};
  std::ofstream(plan.plot) << drawPanels(last.notes.front().substr(last.notes.front().find(' ') + 1), "cameras", counts, panels);
  return last;
}

}  // namespace

Report cameras(const Options& options) {
  Plan plan;
  bool seconds = false;
  for (std::size_t k = 0; k < options.arguments.size(); ++k) {
    const std::string& name = options.arguments[k];
    const auto value = [&]() -> std::string {
      if (k + 1 >= options.arguments.size()) throw std::runtime_error(name + " needs a value");
      return options.arguments[++k];
    };
    if (name == "--count")
      plan.count = std::max(1, std::atoi(value().c_str()));
    else if (name == "--seconds")
      plan.seconds = std::max(0.1, std::atof(value().c_str())), seconds = true;
    else if (name == "--budget")
      plan.budget = static_cast<std::uint32_t>(std::atoll(value().c_str()));
    else if (name == "--bytes-per-second")
      plan.bytesPerSecond = static_cast<std::uint64_t>(std::atoll(value().c_str()));
    else if (name == "--threads")
      plan.server = {"--threads", value()};
    else if (name == "--rest")
      plan.rest = true;
    else if (name == "--table")
      plan.table = true;
    else if (name == "--plot")
      plan.table = true, plan.plot = value();
    else
      throw std::runtime_error("cameras does not know " + name);
  }
  if (options.quick) {
    plan.warmUp = 2;
    if (!seconds) plan.seconds = 3;
  }
  return plan.table ? curve(plan, options) : measure(plan, options);
}

}  // namespace ridgecast::bench
