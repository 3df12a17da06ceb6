#pragma once
// Answers that pages of any origin may read: nothing here uses cookies, and a token is sent by the page itself.

#include <string>

#include "server/http/routes.h"

namespace ridgecast::http {

Answer opened(Answer answer);
Answer openRefusal(unsigned status, std::string sentence, Headers headers = {});
Answer openWrongMethod();
Answer preflight();  // of a page, before it may send its token

}  // namespace ridgecast::http
