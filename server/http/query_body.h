#pragma once
// Reads queries over HTTP, from a URL or a body. Any thread, one at a time for a BodyReader.

#include <cstddef>
#include <functional>
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
  std::size_t mostInUrl;
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
Outcome<std::vector<double>> numbersOfUrl(const QueryForm& form, std::string_view query);
Outcome<wire::Query> queryOf(const QueryForm& form, std::span<const double> all, std::optional<double> option);
Outcome<std::optional<double>> optionOf(const QueryForm& form, std::string_view query);

// Converts the numbers of one place or ray from the client's coordinates to the world's. False: there is no such place.
using ToWorld = std::function<bool(std::span<double> one)>;

// Reads a body, of JSON a little at a time, and places what it asks for.
class BodyReader {
 public:
  // Of numbers that were read before.
  BodyReader(const QueryForm& form, std::vector<double> numbers, std::optional<double> option, ToWorld toWorld)
      : form_(form),
        type_(BodyType::kDoubles),
        option_(option),
        in_(In::kPlacing),
        numbers_(std::move(numbers)),
        toWorld_(std::move(toWorld)) {}
  // `option`: from the URL; JSON's takes precedence.
  BodyReader(const QueryForm& form, BodyType type, std::string body, std::optional<double> option, ToWorld toWorld = {})
      : form_(form), type_(type), body_(std::move(body)), option_(option), toWorld_(std::move(toWorld)) {}
  // Nothing: it is not at the end yet. Error: one sentence.
  std::optional<Outcome<wire::Query>> read();

 private:
  enum class In { kStart, kObject, kList, kPlacing };
  bool take(std::string_view text);  // past white space; false: it is not there
  std::optional<double> number();
  bool member();  // of the object, or the beginning of the list
  bool one();     // of the list
  bool memberEnds();
  std::optional<Outcome<wire::Query>> place();

  const QueryForm& form_;
  const BodyType type_;
  const std::string body_;
  std::optional<double> option_;
  std::size_t at_ = 0;
  In in_ = In::kStart;
  bool sawList_ = false, sawOption_ = false;
  std::vector<double> numbers_;
  ToWorld toWorld_;
  std::size_t placed_ = 0;  // of the numbers
};

}  // namespace ridgecast::http
