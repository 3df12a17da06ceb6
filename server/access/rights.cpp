#include "server/access/rights.h"

#include <algorithm>
#include <array>
#include <utility>

#include "common/outcome/contract.h"
#include "common/text/text.h"

namespace ridgecast::access {

namespace {

constexpr std::array<std::pair<Right, std::string_view>, 7> kNames{{{Right::kView, "view"},
                                                                    {Right::kCreate, "create"},
                                                                    {Right::kQuery, "query"},
                                                                    {Right::kSnapshot, "snapshot"},
                                                                    {Right::kClock, "clock"},
                                                                    {Right::kAdmin, "admin"},
                                                                    {Right::kEdit, "edit"}}};

}  // namespace

std::string_view name(Right right) {
  const auto found = std::ranges::find(kNames, right, &std::pair<Right, std::string_view>::first);
  expects(found != kNames.end(), "each right has a name");
  return found->second;
}

Outcome<Rights> parseRights(std::string_view text) {
  Rights rights;
  bool more = true;
  while (more) {
    more = text.find(',') != std::string_view::npos;
    const std::string_view one = text::takePart(text, ',');
    const auto found = std::ranges::find(kNames, one, &std::pair<Right, std::string_view>::second);
    if (found == kNames.end())
      return Error{"'" + std::string(one.substr(0, 40)) +
                   "' is not a right; rights are view, create, query, snapshot, clock, admin and edit, with commas between them."};
    rights = rights | found->first;
  }
  return rights;
}

std::string toText(Rights rights) {
  std::string text;
  for (const auto& [right, name] : kNames)
    if (rights.has(right)) text.append(text.empty() ? "" : ",").append(name);
  return text;
}

bool holderNameIsValid(std::string_view name) { return !name.empty() && name.size() <= 64 && text::hasOnly(name, "._-@"); }

}  // namespace ridgecast::access
