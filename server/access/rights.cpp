#include "server/access/rights.h"

#include <algorithm>
#include <array>

namespace ridgecast::access {

namespace {

constexpr std::array kAll{Right::kView, Right::kCreate, Right::kQuery, Right::kSnapshot};

}  // namespace

std::string_view name(Right right) {
  switch (right) {
    case Right::kView:
      return "view";
    case Right::kCreate:
      return "create";
    case Right::kQuery:
      return "query";
    case Right::kSnapshot:
      return "snapshot";
  }
  return "";
}

Outcome<Rights> parseRights(std::string_view text) {
  Rights rights;
  for (std::string_view rest = text;;) {
    const auto end = std::min(rest.find(','), rest.size());
    const std::string_view one = rest.substr(0, end);
    const auto found = std::find_if(kAll.begin(), kAll.end(), [one](Right right) { return name(right) == one; });
    if (found == kAll.end())
      return Error{"'" + std::string(one.substr(0, 40)) +
                   "' is no right; rights are view, create, query and snapshot, with commas between them."};
    rights = rights | *found;
    if (end == rest.size()) return rights;
    rest.remove_prefix(end + 1);
  }
}

std::string toText(Rights rights) {
  std::string text;
  for (const Right right : kAll) {
    if (!rights.has(right)) continue;
    if (!text.empty()) text += ',';
    text += name(right);
  }
  return text;
}

}  // namespace ridgecast::access
