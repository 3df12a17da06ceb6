#include "server/http/site.h"

#include <array>
#include <system_error>
#include <utility>

#include "common/text/file.h"
#include "common/text/text.h"
#include "server/access/crypto.h"
#include "server/access/host.h"

namespace ridgecast::http {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::pair<std::string_view, std::string_view>, 10> kTypes{{{".html", "text/html; charset=utf-8"},
                                                                                {".js", "text/javascript; charset=utf-8"},
                                                                                {".css", "text/css; charset=utf-8"},
                                                                                {".wasm", "application/wasm"},
                                                                                {".svg", "image/svg+xml"},
                                                                                {".png", "image/png"},
                                                                                {".jpg", "image/jpeg"},
                                                                                {".ico", "image/x-icon"},
                                                                                {".json", "application/json"},
                                                                                {".txt", "text/plain; charset=utf-8"}}};

std::string typeOf(const fs::path& name) {
  const std::string extension = name.extension().string();
  for (const auto& [known, type] : kTypes)
    if (extension == known) return std::string(type);
  return "application/octet-stream";
}

// The next part of a list, taken off the front of `rest`.
std::string_view next(std::string_view& rest, char separator) { return text::trimmed(text::takePart(rest, separator)); }

bool accepts(std::string_view header, std::string_view coding) {
  while (!header.empty()) {
    std::string_view part = next(header, ',');
    if (!access::sameIgnoringCase(next(part, ';'), coding)) continue;
    while (!part.empty()) {
      const std::string_view parameter = next(part, ';');
      if (parameter.size() >= 2 && (parameter[0] == 'q' || parameter[0] == 'Q') && parameter[1] == '=')
        return parameter.find_first_of("123456789") != std::string_view::npos;
    }
    return true;
  }
  return false;
}

// ws://HOST:PORT or wss://HOST:PORT of a URL as clients read it (PROTOCOL.md, World and access); empty: it is none.
std::string webSocketOrigin(std::string_view url) {
  std::string_view scheme = "ws://", port = ":7070";
  for (const auto& [begins, becomes, usual] : {std::array<std::string_view, 3>{"ws://", "ws://", ":80"},
                                               {"http://", "ws://", ":80"},
                                               {"wss://", "wss://", ":443"},
                                               {"https://", "wss://", ":443"}})
    if (access::sameIgnoringCase(url.substr(0, begins.size()), begins)) {
      scheme = becomes, port = usual;
      url.remove_prefix(begins.size());
      break;
    }
  const std::string_view host = url.substr(0, url.find_first_of("/?#"));
  if (host.empty() || !text::hasOnly(host, ".-_:[]")) return {};
  const bool hasPort = host.rfind(':') != host.npos && host.rfind(':') > (host.rfind(']') == host.npos ? 0 : host.rfind(']'));
  return std::string(scheme) + std::string(host) + (hasPort ? "" : std::string(port));
}

// Draco's decoder is WebAssembly. 'wasm-unsafe-eval' allows that, but not eval.
std::string policyFor(const std::string& reconnectUrl) {
  return "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; img-src 'self' blob:; "
         "connect-src 'self'" +
         (reconnectUrl.empty() ? "" : " " + webSocketOrigin(reconnectUrl)) +
         "; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
}

Answer answerOf(const File& file, const Request& request, const std::string& policy) {
  const Form form = formFor(file, request.acceptEncoding);
  Answer a;
  a.type = file.type;
  a.etag = form.encoding.empty() ? file.tag : file.tag + "-" + std::string(form.encoding);
  a.headers = {{"Vary", "Accept-Encoding"},
               {"Content-Security-Policy", policy},
               {"Cross-Origin-Opener-Policy", "same-origin"},
               {"Referrer-Policy", "no-referrer"}};
  if (file.immutable) a.headers.emplace_back("Cache-Control", "public, max-age=31536000, immutable");
  if (!form.encoding.empty()) a.headers.emplace_back("Content-Encoding", std::string(form.encoding));
  a.body = std::string(form.bytes);
  return a;
}

}  // namespace

Outcome<std::shared_ptr<const Site>> Site::load(const fs::path& folder) {
  const auto refuse = [&](const std::string& why) { return Error{"The folder of the page, '" + folder.string() + "', " + why}; };
  std::error_code ec;
  fs::recursive_directory_iterator at(folder, ec), end;
  if (ec) return refuse("cannot be read (" + ec.message() + "); ./run build makes one in build/web.");
  auto site = std::make_shared<Site>();
  std::map<std::string, std::string> found;
  std::size_t bytes = 0;
  for (; at != end; at.increment(ec)) {
    const fs::path name = at->path().filename();
    if (name.string().starts_with(".")) {
      if (at->is_directory(ec)) at.disable_recursion_pending();
      continue;
    }
    if (at->symlink_status(ec).type() != fs::file_type::regular) continue;
    const auto size = at->file_size(ec);
    if (ec || size > kMaxBytes - bytes || found.size() >= kMaxFiles)
      return refuse("has more than " + std::to_string(kMaxFiles) + " files or " + std::to_string(kMaxBytes >> 20) +
                    " MiB; it should hold the built page alone.");
    bytes += size;
    auto text = text::readFile(at->path(), size);
    if (!text || text->size() != size) return refuse("has a file that cannot be read, '" + name.string() + "'.");
    found.emplace("/" + at->path().lexically_relative(folder).generic_string(), std::move(*text));
  }
  if (ec) return refuse("cannot be read (" + ec.message() + ").");
  if (!found.contains("/index.html")) return refuse("has no index.html; ./run build makes one in build/web.");
  const auto take = [&](const std::string& path) {
    const auto it = found.find(path);
    return it == found.end() ? std::string() : std::move(it->second);
  };
  for (auto& [path, text] : found) {
    const std::string extension = fs::path(path).extension().string();
    if ((extension == ".br" || extension == ".gz") && found.contains(path.substr(0, path.size() - 3))) continue;
    File file;
    file.type = typeOf(path);
    file.tag = access::hex(access::sha256(text)).substr(0, 32);
    file.immutable = path.starts_with("/assets/");
    file.plain = text;
    file.brotli = take(path + ".br");
    file.gzip = take(path + ".gz");
    site->files_.emplace(path, std::move(file));
  }
  return std::shared_ptr<const Site>(std::move(site));
}

std::optional<fs::path> Site::defaultFolder() {
  std::error_code ec;
  const fs::path program = fs::read_symlink("/proc/self/exe", ec);
  if (ec) return {};
  for (const char* where : {"../share/ridgecast/web", "../../web"}) {
    const fs::path folder = (program.parent_path() / where).lexically_normal();
    if (fs::is_regular_file(folder / "index.html", ec)) return folder;
  }
  return {};
}

const File* Site::find(std::string_view path) const {
  const auto it = files_.find(path == "/" ? std::string_view("/index.html") : path);
  return it == files_.end() ? nullptr : &it->second;
}

Form formFor(const File& file, std::string_view acceptEncoding) {
  if (!file.brotli.empty() && accepts(acceptEncoding, "br")) return {file.brotli, "br"};
  if (!file.gzip.empty() && accepts(acceptEncoding, "gzip")) return {file.gzip, "gzip"};
  return {file.plain, {}};
}

Route pageRoute(std::shared_ptr<const Site> site, const std::string& reconnectUrl) {
  return [site = std::move(site), policy = policyFor(reconnectUrl)](const Request& request) -> std::optional<Reply> {
    if (request.upgrade) return {};
    const File* file = site->find(request.path());
    if (!file) return {};
    return request.reads() ? answerOf(*file, request, policy) : wrongMethod();
  };
}

}  // namespace ridgecast::http
