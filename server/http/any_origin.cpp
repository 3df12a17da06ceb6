#include "server/http/any_origin.h"

#include <utility>

namespace ridgecast::http {

Answer opened(Answer a) {
  a.headers.emplace_back("Access-Control-Allow-Origin", "*");
  a.headers.emplace_back("Access-Control-Expose-Headers", "Content-Disposition, Content-Length, ETag, Retry-After");
  return a;
}

Answer openRefusal(unsigned status, std::string sentence, Headers headers) {
  return opened(plain(status, std::move(sentence), std::move(headers)));
}

Answer openWrongMethod() { return opened(wrongMethod("GET, HEAD, OPTIONS")); }

Answer preflight() {
  Answer a;
  a.status = 204;
  a.headers = {{"Access-Control-Allow-Methods", "GET, HEAD"},
               {"Access-Control-Allow-Headers", "Authorization, If-None-Match"},
               {"Access-Control-Max-Age", "86400"}};
  return opened(std::move(a));
}

}  // namespace ridgecast::http
