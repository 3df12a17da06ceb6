#pragma once
// The browser viewer's files, as client/web builds them. Read once into memory and found only by their exact path, so no request reaches
// the file system. Immutable after load(); every member may be called from any thread.
//
// A file NAME may come with NAME.br and NAME.gz, the same bytes compressed. They are offered to browsers that accept them and are not files
// of their own. The browser may keep a file for a year if its name holds a hash. A policy lets the page load its own files and contact its
// own server, nothing else.

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/http/routes.h"

namespace ridgecast::http {

inline constexpr std::size_t kMaxFiles = 1024;
inline constexpr std::size_t kMaxBytes = std::size_t{64} << 20;  // of all files, compressed forms included

struct File {
  std::string type;                 // as in Content-Type
  std::string tag;                  // equal for equal bytes
  bool immutable = false;           // its name holds a hash of its bytes
  std::string plain, gzip, brotli;  // compressed forms are empty when there are none
};

class Site {
 public:
  // Error: the folder has no index.html, cannot be read, or exceeds the limits above. Skips links and hidden files.
  static Outcome<std::shared_ptr<const Site>> load(const std::filesystem::path& folder);
  // The folder, relative to this program, where the page is installed or built: ../share/ridgecast/web, otherwise ../../web. Empty:
  // neither.
  static std::optional<std::filesystem::path> defaultFolder();

  // `path` begins with a slash; "/" is /index.html. Null: no such file.
  const File* find(std::string_view path) const;

 private:
  std::map<std::string, File, std::less<>> files_;  // by path, with its slash
};

// A file's form for an Accept-Encoding header (RFC 9110; q = 0 forbids): its bytes and the Content-Encoding (empty: none).
struct Form {
  std::string_view bytes, encoding;
};
Form formFor(const File& file, std::string_view acceptEncoding);

// Answers GET and HEAD for the site's files and leaves everything else to other routes. Any thread. `reconnectUrl`: of the server to which
// the page may be sent (net::Settings); empty: none.
Route pageRoute(std::shared_ptr<const Site> site, const std::string& reconnectUrl = {});

}  // namespace ridgecast::http
