#include "client/viewer/arrival.h"

namespace ridgecast::viewer {

using namespace std::chrono_literals;

Arrival::Arrival(const connection::Url& url, const wire::Settings& settings) : where_(url.host + ":" + url.port) {
  connection::Waiting waiting;
  waiting.preparing = [this] { prepares_ = true; };
  waiting.stop = stop_.get_token();
  link_ = std::async(std::launch::async, [url, settings, waiting] { return Link::open(url, settings, waiting); });
}

Arrival::~Arrival() { stop_.request_stop(); }

std::optional<Outcome<Link>> Arrival::take() {
  if (!link_.valid() || link_.wait_for(0ms) != std::future_status::ready) return std::nullopt;
  return link_.get();
}

double Arrival::seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count(); }

std::string Arrival::describe() const {
  return "waiting for " + where_ + (prepares_ ? " to prepare the terrain, " : " to answer, ") +
         std::to_string(static_cast<int>(seconds())) + " s";
}

}  // namespace ridgecast::viewer
