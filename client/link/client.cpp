#include "client/link/client.h"

#include <algorithm>
#include <atomic>
#include <future>
#include <string>
#include <thread>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::link {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

namespace {

// What `work` returns, and how long it took.
template <class Work>
auto timed(double& milliseconds, const Work& work) {
  const auto began = Clock::now();
  auto done = work();
  milliseconds = std::chrono::duration<double, std::milli>(Clock::now() - began).count();
  return done;
}

// Scene::Spread, where there is much to do on a few threads of its own.
void onThreads(std::size_t count, std::size_t bytes, const std::function<void(std::size_t)>& work) {
  constexpr std::size_t kWorthAThread = 8 << 10, kMaxThreads = 4;
  std::atomic<std::size_t> next{0};
  const auto some = [&] {
    for (std::size_t k = next++; k < count; k = next++) work(k);
  };
  std::vector<std::future<void>> others(
      std::min({bytes / kWorthAThread, kMaxThreads - 1, std::size_t{std::max(1u, std::thread::hardware_concurrency())} - 1}));
  for (auto& other : others) other = std::async(std::launch::async, some);
  some();
  for (auto& other : others) other.get();
}

}  // namespace

Outcome<std::unique_ptr<Client>> Client::open(const core::Url& url, const wire::Hello& hello, const Options& options) {
  wire::Hello follows = hello;
  follows.points = true;
  std::unique_ptr<Client> client(new Client(url, std::move(follows), options));
  if (auto connected = client->enterOtherWorld(); !connected) return connected.error();
  return client;
}

Outcome<void> Client::enterOtherWorld() {
  auto opened = Connection::open(url_, hello_, options_, [this](const wire::World& coming) {
    resumed_ += scene().index().size();
    return follower_.enter(coming);
  });
  if (!opened) return opened.error();
  decoding_.reset();  // reads the mesh held
  follower_ = {};
  connection_ = std::move(*opened);
  tilesFrom_ = editsFrom_ = editOf_ = 0;
  edit_ = world().edit;
  follower_.follow({hello_.points, world().shadedVertices, world().settings.triangleBudget, onThreads});
  follower_.enter(world());
  return {};
}

std::uint64_t Client::send(const camera::Camera& camera, std::vector<std::uint8_t> state) {
  connection_->send({++sequence_, camera, std::move(state)});
  return sequence_;
}

std::optional<core::Received> Client::hear(std::chrono::milliseconds timeout) {
  auto received = connection_->receive(timeout);
  if (std::exchange(editOf_, connection_->reconnections()) != connection_->reconnections()) edit_ = world().edit;
  return received;
}

std::optional<Update> Client::receive(std::chrono::milliseconds timeout) {
  if (decoding_) return poll(timeout, {});
  auto received = hear(timeout);
  if (!received) return std::nullopt;
  Decoding decoding{std::move(*received)};
  core::Follower::Answer answered = timed(decoding.milliseconds, [&] { return follower_.apply(decoding.received.iteration); });
  return answer(std::move(decoding), std::move(answered));
}

Outcome<Update> Client::await(std::uint64_t sequence, std::chrono::milliseconds timeout) {
  expects(sequence > 0 && sequence <= sequence_, "a pose that is awaited was sent");
  for (const auto until = Clock::now() + timeout;;) {
    auto update = receive(std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()));
    if (update && update->iteration.poseSequence >= sequence) return std::move(*update);
    if (update) continue;
    if (const auto why = connection_->error()) return *why;
    return Error{"the server has not answered a pose for " + std::to_string(timeout / 1s) +
                 " s: look at its log, or ask for fewer triangles"};
  }
}

Outcome<bool> Client::exchangeTiles(core::HeightWindow& window) {
  if (std::exchange(tilesFrom_, connection_->reconnections()) != connection_->reconnections()) window.forgetRequests();
  const auto tiles = connection_->takeTiles();
  for (const wire::HeightTile& tile : tiles)
    if (auto put = window.put(tile); !put) return put.error();
  if (auto missing = window.take(); !missing.empty()) connection_->want(wire::WantTiles{std::move(missing)});
  return !tiles.empty();
}

Outcome<bool> Client::exchangeEdits(core::HeldEdits& edits) {
  if (world().revision < 5 || world().terrainSource.empty()) return false;
  if (std::exchange(editsFrom_, connection_->reconnections()) != connection_->reconnections()) edits.reconnected(edit_);
  const auto [found, squares] = connection_->takeEditsFound();
  for (const wire::FoundEdits& f : found)
    if (auto put = edits.put(f); !put) return put.error();
  for (const wire::Squares& s : squares)
    if (auto put = edits.put(s); !put) return put.error();
  edits.know(edit_);
  if (const auto [find, want] = edits.take(); find || !want.squares.empty()) {
    if (find) connection_->find(*find);
    if (!want.squares.empty()) connection_->want(want);
  }
  return !found.empty() || !squares.empty();
}

std::optional<Update> Client::poll(std::chrono::milliseconds soon, const std::function<void()>& ready) {
  if (!decoding_) {
    auto received = hear(0ms);
    if (!received) return std::nullopt;
    decoding_ = std::make_unique<Decoding>(Decoding{std::move(*received)});
    scene().leaves();  // after receive() some may not be made
    decoding_->prepared = std::async(std::launch::async, [this, decoding = decoding_.get(), ready] {
      auto prepared = timed(decoding->milliseconds, [&] { return follower_.prepare(decoding->received.iteration); });
      if (ready) ready();
      return prepared;
    });
  }
  if (decoding_->prepared.wait_for(soon) != std::future_status::ready) return std::nullopt;
  const std::unique_ptr<Decoding> decoding = std::move(decoding_);
  core::Follower::Answer answered = follower_.take(decoding->received.iteration, decoding->prepared.get());
  return answer(std::move(*decoding), std::move(answered));
}

Update Client::answer(Decoding&& decoding, core::Follower::Answer answer) {
  Update update{std::move(decoding.received.iteration), decoding.received.bytes, decoding.milliseconds, {}};
  if (answer.resend) connection_->resend(*answer.resend);
  connection_->acknowledge(answer.acknowledge);
  update.wrong = std::move(answer.wrong);
  edit_ = std::max(edit_, update.iteration.edit);
  return update;
}

}  // namespace ridgecast::link
