#include "server/snapshot/parameters.h"

#include <utility>

#include "common/outcome/contract.h"
#include "common/text/text.h"

namespace ridgecast::snapshot {
namespace {

constexpr std::size_t kMaxParameters = 32;

std::string text(double v) { return text::rounded(v, 12); }

std::string beginning(const char* name, std::string_view value, const char* what) {
  return inQuotes(name).append(" is ").append(inQuotes(value)).append("; it must be ").append(what);
}

}  // namespace

std::string inQuotes(std::string_view text) {
  std::string out = "'";
  for (const char c : text.substr(0, 40)) out += c >= ' ' && c <= '~' && c != '\'' && c != '\\' ? c : '?';
  return out + (text.size() > 40 ? "...'" : "'");
}

Outcome<void> Parameters::read(std::string_view query) {
  while (!query.empty()) {
    std::string_view part = text::takePart(query, '&');
    if (part.empty()) continue;
    const auto name = text::percentDecoded(text::takePart(part, '=')), value = text::percentDecoded(part);
    if (!name || !value) return Error{"The query has a % without two hexadecimal digits after it."};
    if (values_.size() >= kMaxParameters)
      return Error{"The query has more than " + std::to_string(kMaxParameters) + " parameters, the limit."};
    if (!values_.emplace(*name, *value).second) return Error{"The query has " + inQuotes(*name) + " twice; give it once."};
  }
  return {};
}

std::optional<std::string> Parameters::take(const std::string& name) {
  const auto it = values_.find(name);
  if (it == values_.end()) return std::nullopt;
  std::string value = std::move(it->second);
  values_.erase(it);
  return value;
}

double Parameters::number(const char* name, double low, double high, const char* unit, std::optional<double> otherwise) {
  expects(low <= high, "a range has a number in it");
  const auto value = take(name);
  if (!value) {
    if (!otherwise) refuse("The query lacks " + inQuotes(name) + ", a number from " + text(low) + " to " + text(high) + unit + ".");
    return otherwise.value_or(low);
  }
  if (const auto v = text::number<double>(*value); v && *v >= low && *v <= high) return *v;
  refuse(beginning(name, *value, "a number from ") + text(low) + " to " + text(high) + unit + ".");
  return low;
}

std::uint64_t Parameters::whole(const char* name, std::uint64_t low, std::uint64_t high, const char* unit,
                                std::optional<std::uint64_t> otherwise) {
  expects(low <= high, "a range has a number in it");
  const auto value = take(name);
  if (!value && otherwise) return *otherwise;
  if (const auto v = text::number<std::uint64_t>(value.value_or("")); v && *v >= low && *v <= high) return *v;
  refuse(beginning(name, value.value_or(""), "a whole number from ") + std::to_string(low) + " to " + std::to_string(high) + unit + ".");
  return low;
}

bool Parameters::flag(const char* name, bool otherwise) {
  const auto value = take(name);
  if (!value) return otherwise;
  if (*value == "1") return true;
  if (*value != "0") refuse(beginning(name, *value, "0 or 1."));
  return false;
}

void Parameters::refuse(std::string sentence) {
  if (!error_) error_ = Error{std::move(sentence)};
}

std::optional<Error> Parameters::finish(std::string_view known) {
  if (!error_ && !values_.empty())
    refuse("The query says " + inQuotes(values_.begin()->first) + ", which does not belong here. " + std::string(known));
  return error_;
}

}  // namespace ridgecast::snapshot
