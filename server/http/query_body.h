#pragma once
// What a query over HTTP asks: from a URL, or from a body. Any thread, one at a time for a BodyReader.

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::http {

// A kind of query.
struct QueryForm {
  wire::QueryKind kind;
  std::string_view path;
  std::string_view parameter, list;  // that name what is asked: in a URL, in JSON
  std::size_t numbers;               // of each
  std::size_t mostInUrl, mostInBody;
  const char* isOne;        // each
  std::string_view option;  // in a URL and in JSON
  const char* isOption;
};
const QueryForm* queryFormOf(std::string_view path);  // null: no query's

enum class BodyType { kJson, kDoubles };
std::optional<BodyType> bodyTypeOf(std::string_view contentType);
// Bytes that the longest body may have.
std::size_t mostBytes(const QueryForm& form, BodyType type);

// Error: one sentence.
Outcome<wire::Query> queryOfUrl(const QueryForm& form, std::string_view query);
Outcome<std::optional<double>> optionOf(const QueryForm& form, std::string_view query);

// Reads a body, of JSON a little at a time.
class BodyReader {
 public:
  // `option`: from the URL; JSON's counts before it.
  BodyReader(const QueryForm& form, BodyType type, std::string body, std::optional<double> option)
      : form_(form), type_(type), body_(std::move(body)), option_(option) {}
  // Nothing: it is not at the end yet. Error: one sentence.
  std::optional<Outcome<wire::Query>> read();

 private:
  enum class In { kStart, kObject, kList, kEnd };
  bool take(std::string_view text);  // past white space; false: it is not there
  std::optional<double> number();
  bool member();  // of the object, or the beginning of the list
  bool one();     // of the list
  bool memberEnds();

  const QueryForm& form_;
  const BodyType type_;
  const std::string body_;
  std::optional<double> option_;
  std::size_t at_ = 0;
  In in_ = In::kStart;
  bool sawList_ = false, sawOption_ = false;
  std::vector<double> numbers_;
};

}  // namespace ridgecast::http
