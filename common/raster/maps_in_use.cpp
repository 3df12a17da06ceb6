#include <sys/stat.h>

#include <array>
#include <mutex>
#include <vector>

#include "common/raster/map.h"

namespace ridgecast::raster {
namespace {

// The maps in use, by file and options.
class Maps {
 public:
  Outcome<std::shared_ptr<const Map>> open(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
                                           const std::stop_token& stop) {
    const Key key{path, options, versionOf(path), versionOf(options.drape), versionOf(options.classes)};
    const std::lock_guard lock(mutex_);
    std::uint64_t used = 0;
    for (const Entry& entry : inUse()) {
      auto map = entry.map.lock();
      if (!map) continue;
      if (entry.key == key && entry.sources == versionsOf(*map)) return map;
      used += map->bytes();
    }
    auto made = readMap(path, options, limits, used, stop);
    if (made) entries_.push_back({key, *made, versionsOf(**made)});
    return made;
  }
  std::vector<std::filesystem::path> sourcesOf(const std::filesystem::path& path) {
    const std::lock_guard lock(mutex_);
    for (const Entry& entry : inUse())
      if (const auto map = entry.key.path == path ? entry.map.lock() : nullptr) return map->sources;
    return {};
  }
  std::uint64_t bytes() {
    const std::lock_guard lock(mutex_);
    std::uint64_t sum = 0;
    for (const Entry& entry : inUse())
      if (const auto map = entry.map.lock()) sum += map->bytes();
    return sum;
  }

 private:
  using Version = std::array<std::int64_t, 6>;  // of the file: another if it was replaced or written
  struct Key {
    std::filesystem::path path;
    RasterOptions options;
    Version version, drape, classes;
    friend bool operator==(const Key&, const Key&) = default;
  };
  struct Entry {
    Key key;
    std::weak_ptr<const Map> map;
    std::vector<Version> sources;
  };
  static std::vector<Version> versionsOf(const Map& map) {
    std::vector<Version> out;
    for (const auto& source : map.sources) out.push_back(versionOf(source));
    return out;
  }
  static Version versionOf(const std::filesystem::path& path) {
    struct stat s {};
    if (stat(path.c_str(), &s) != 0) return {};  // opening it says why
    return {static_cast<std::int64_t>(s.st_dev),
            static_cast<std::int64_t>(s.st_ino),
            s.st_size,
            s.st_mtim.tv_sec,
            s.st_mtim.tv_nsec,
            s.st_ctim.tv_nsec};
  }
  const std::vector<Entry>& inUse() {
    std::erase_if(entries_, [](const Entry& entry) { return entry.map.expired(); });
    return entries_;
  }

  std::mutex mutex_;
  std::vector<Entry> entries_;
};

Maps& maps() {
  static Maps all;
  return all;
}

}  // namespace

Outcome<std::shared_ptr<const Map>> openMap(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
                                            const std::stop_token& stop) {
  return maps().open(path, options, limits, stop);
}

std::vector<std::filesystem::path> otherFilesOf(const std::filesystem::path& map) { return maps().sourcesOf(map); }

std::uint64_t bytesOfMaps() { return maps().bytes(); }

}  // namespace ridgecast::raster
