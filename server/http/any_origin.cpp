#include "server/http/any_origin.h"

#include <utility>

namespace ridgecast::http {

void open(Answer& a) {
  a.headers.emplace_back("Access-Control-Allow-Origin", "*");
  a.headers.emplace_back("Access-Control-Expose-Headers", "Content-Disposition, Content-Length, ETag, Retry-After");
}

Answer openRefusal(unsigned status, std::string sentence, Headers headers) {
  Answer a = plain(status, std::move(sentence), std::move(headers));
  open(a);
  return a;
}

Answer openWrongMethod() {
  Answer a = wrongMethod("GET, HEAD, OPTIONS");
  open(a);
  return a;
}

Answer preflight() {
  Answer a;
  a.status = 204;
  open(a);
  a.headers.emplace_back("Access-Control-Allow-Methods", "GET, HEAD");
  a.headers.emplace_back("Access-Control-Allow-Headers", "Authorization, If-None-Match");
  a.headers.emplace_back("Access-Control-Max-Age", "86400");
  return a;
}

}  // namespace ridgecast::http
