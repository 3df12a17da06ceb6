#include "common/keys/keys.h"

#include <nlohmann/json.hpp>

#include "common/keys/embedded.h"

namespace ridgecast::keys {

const std::vector<Row>& table() {
  static const std::vector<Row> rows = [] {
    std::vector<Row> out;
    for (const auto& row : nlohmann::json::parse(embedded::keys)) out.push_back({row["action"], row["keys"], row["words"], row["where"]});
    return out;
  }();
  return rows;
}

std::vector<std::string> strokesOf(const Row& row) {
  static const std::string kBetween = " / ";
  std::vector<std::string> out;
  for (std::size_t from = 0; from != std::string::npos;) {
    const std::size_t to = row.keys.find(kBetween, from);
    out.push_back(row.keys.substr(from, to == std::string::npos ? to : to - from));
    from = to == std::string::npos ? to : to + kBetween.size();
  }
  return out;
}

}  // namespace ridgecast::keys
