#include "server/http/page.h"

#include <algorithm>
#include <string>
#include <utility>

namespace ridgecast::http {
namespace {

// Draco's decoder is WebAssembly. 'wasm-unsafe-eval' allows that, but not eval.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

Answer answerOf(const File& file, const Request& request) {
  const Form form = formFor(file, request.acceptEncoding);
  Answer a;
  a.type = file.type;
  a.etag = form.encoding.empty() ? file.tag : file.tag + "-" + std::string(form.encoding);
  a.headers = {{"Vary", "Accept-Encoding"},
               {"Content-Security-Policy", kPolicy},
               {"Cross-Origin-Opener-Policy", "same-origin"},
               {"Referrer-Policy", "no-referrer"}};
  if (file.immutable) a.headers.emplace_back("Cache-Control", "public, max-age=31536000, immutable");
  if (!form.encoding.empty()) a.headers.emplace_back("Content-Encoding", std::string(form.encoding));
  a.body = std::string(form.bytes);
  return a;
}

}  // namespace

Route pageRoute(std::shared_ptr<const Site> site) {
  return [site = std::move(site)](const Request& request) -> std::optional<Answer> {
    if (request.upgrade) return {};
    const File* file = site->find(request.path());
    if (!file) return {};
    return request.reads() ? answerOf(*file, request) : wrongMethod();
  };
}

}  // namespace ridgecast::http
