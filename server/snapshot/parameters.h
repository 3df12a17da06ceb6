#pragma once
// The parameters of a URL's query, taken one by one. The first error counts: one sentence that says what is wrong and what would be right.

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::snapshot {

// Repeats only harmless text of a URL, which may contain anything.
std::string inQuotes(std::string_view text);

class Parameters {
 public:
  // `query` is the part of a URL after the ?, still percent-encoded. Error: an invalid escape, a name twice, or more than 32 names.
  Outcome<void> read(std::string_view query);

  bool has(const std::string& name) const { return values_.contains(name); }
  std::optional<std::string> take(const std::string& name);

  // A number within its range. If missing: `otherwise`, or an error without it. After the first error all calls fail.
  double number(const char* name, double low, double high, const char* unit, std::optional<double> otherwise = {});
  std::uint64_t whole(const char* name, std::uint64_t low, std::uint64_t high, const char* unit,
                      std::optional<std::uint64_t> otherwise = {});
  bool flag(const char* name, bool otherwise);  // 0 or 1

  void refuse(std::string sentence);
  // The first error. A parameter that was not taken is an error too; `known` lists the valid ones.
  std::optional<Error> finish(std::string_view known);

 private:
  std::map<std::string, std::string> values_;
  std::optional<Error> error_;
};

}  // namespace ridgecast::snapshot
