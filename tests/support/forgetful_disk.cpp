#include "tests/support/forgetful_disk.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/process.h"

namespace ridgecast::testing_support {
namespace {

struct Write {
  sqlite3_int64 at = 0;
  std::string bytes;
  bool truncates = false;  // to `at`
};

void applyWrite(const Write& write, std::string& content) {
  const auto at = static_cast<std::size_t>(write.at);
  if (write.truncates) {
    content.resize(std::min(content.size(), at));
    return;
  }
  if (content.size() < at + write.bytes.size()) content.resize(at + write.bytes.size());
  content.replace(at, write.bytes.size(), write.bytes);
}

struct Content {
  std::string path, now;  // what a reader sees
  std::vector<Write> unsynced;
  bool isNewJournal = false;  // whose first sync also syncs the folder, as SQLite's own files do
  std::uint64_t number = 0;
};
struct Removed {
  std::string bytes;
  std::uint64_t number = 0;
};

constexpr std::uint64_t kNever = ~std::uint64_t{0};

struct State {
  std::mt19937_64& random;
  std::map<std::string, std::shared_ptr<Content>> open;
  std::map<std::string, Removed> removed;  // without a sync of their folder
  std::uint64_t numbered = 0;              // files that were opened or removed: tests' folders have random names, and so no order
  std::uint64_t untilCut = kNever, untilFull = kNever, lost = 0;
  bool isOff = false;
};
std::unique_ptr<State> state;
sqlite3_vfs* real = nullptr;
sqlite3_vfs forgetful;

void writeTo(const std::string& path, const std::string& bytes) { std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes; }

template <class Files>
auto inOrder(const Files& files, const auto& numberOf) {
  std::map<std::uint64_t, std::pair<std::string, typename Files::mapped_type>> out;
  for (const auto& [path, file] : files) out.emplace(numberOf(file), std::pair(path, file));
  return out;
}

void cutPowerNow() {
  state->isOff = true;
  for (const auto& [number, file] : inOrder(state->open, [](const auto& c) { return c->number; })) {
    const auto& [path, content] = file;
    std::string durable = readText(path);
    const std::uint64_t share = state->random() % 5;  // of 4 writes are kept
    std::size_t torn = content->unsynced.empty() ? 0 : state->random() % content->unsynced.size();
    for (std::size_t k = 0; k < content->unsynced.size(); ++k) {
      Write& write = content->unsynced[k];
      if (k == torn && !write.truncates) {
        const std::size_t borders = (static_cast<std::size_t>(write.at) % 512 + write.bytes.size()) / 512;
        const std::size_t end = borders == 0 ? 0 : state->random() % (borders + 1) * 512;
        const std::size_t begin = static_cast<std::size_t>(write.at) % 512;
        write.bytes.resize(end > begin ? std::min(write.bytes.size(), end - begin) : 0);
        ++state->lost;
      } else if (state->random() % 4 >= share) {
        ++state->lost;
        continue;
      }
      applyWrite(write, durable);
    }
    writeTo(path, durable);
  }
  for (const auto& [number, file] : inOrder(state->removed, [](const Removed& r) { return r.number; }))
    if (state->random() % 2) writeTo(file.first, file.second.bytes);
  state->open.clear();
  state->removed.clear();
}

// Whether the power is on, after one more operation.
bool isOn() {
  if (state->isOff) return false;
  if (state->untilCut != kNever && --state->untilCut == 0) cutPowerNow();
  return !state->isOff;
}

struct File {
  sqlite3_file base;
  Content* content;    // null once the power is off
  sqlite3_file* real;  // for its locks
};
File& of(sqlite3_file* file) { return *reinterpret_cast<File*>(file); }
Content* contentOf(sqlite3_file* file) { return state->isOff ? nullptr : of(file).content; }

void sync(Content& content) {
  const auto folderOf = [](const std::string& path) { return std::filesystem::path(path).parent_path(); };
  if (content.isNewJournal) std::erase_if(state->removed, [&](const auto& file) { return folderOf(file.first) == folderOf(content.path); });
  content.isNewJournal = false;
  std::fstream file(content.path, std::ios::binary | std::ios::in | std::ios::out);
  for (const Write& write : content.unsynced) {
    if (write.truncates) {
      file.flush();
      std::filesystem::resize_file(content.path, std::min(std::filesystem::file_size(content.path), static_cast<std::uintmax_t>(write.at)));
    } else {
      file.seekp(write.at).write(write.bytes.data(), static_cast<std::streamsize>(write.bytes.size()));
    }
  }
  content.unsynced.clear();
}

int closeFile(sqlite3_file* file) {
  if (Content* const content = contentOf(file)) {  // written sometime, as nothing cuts the power before
    sync(*content);
    state->open.erase(content->path);
  }
  const int code = of(file).real->pMethods->xClose(of(file).real);
  sqlite3_free(of(file).real);
  return code;
}

int readFile(sqlite3_file* file, void* to, int size, sqlite3_int64 at) {
  const Content* const content = contentOf(file);
  if (!content) return SQLITE_IOERR_READ;
  const auto wanted = static_cast<std::size_t>(size), from = std::min(static_cast<std::size_t>(at), content->now.size());
  const std::size_t there = std::min(wanted, content->now.size() - from);
  std::memcpy(to, content->now.data() + from, there);
  std::memset(static_cast<char*>(to) + there, 0, wanted - there);
  return there == wanted ? SQLITE_OK : SQLITE_IOERR_SHORT_READ;
}

int change(sqlite3_file* file, Write write) {
  if (!isOn()) return SQLITE_IOERR_WRITE;
  if (state->untilFull != kNever && (state->untilFull == 0 || --state->untilFull == 0)) return SQLITE_FULL;
  Content* const content = contentOf(file);
  applyWrite(write, content->now);
  content->unsynced.push_back(std::move(write));
  return SQLITE_OK;
}
int writeFile(sqlite3_file* file, const void* from, int size, sqlite3_int64 at) {
  return change(file, {at, std::string(static_cast<const char*>(from), static_cast<std::size_t>(size))});
}
int truncateFile(sqlite3_file* file, sqlite3_int64 size) { return change(file, {size, "", true}); }

int syncFile(sqlite3_file* file, int) {
  if (!isOn()) return SQLITE_IOERR_FSYNC;
  sync(*contentOf(file));
  return SQLITE_OK;
}
int sizeOf(sqlite3_file* file, sqlite3_int64* size) {
  if (!contentOf(file)) return SQLITE_IOERR_FSTAT;
  *size = static_cast<sqlite3_int64>(contentOf(file)->now.size());
  return SQLITE_OK;
}
int lock(sqlite3_file* file, int level) { return of(file).real->pMethods->xLock(of(file).real, level); }
int unlock(sqlite3_file* file, int level) { return of(file).real->pMethods->xUnlock(of(file).real, level); }
int isReserved(sqlite3_file* file, int* out) { return of(file).real->pMethods->xCheckReservedLock(of(file).real, out); }
int control(sqlite3_file*, int, void*) { return SQLITE_NOTFOUND; }
int sectorSize(sqlite3_file* file) { return of(file).real->pMethods->xSectorSize(of(file).real); }
int abilities(sqlite3_file* file) { return of(file).real->pMethods->xDeviceCharacteristics(of(file).real); }

// Version 1: without shared memory, which a log that is open once does not need.
constexpr sqlite3_io_methods kMethods{1,       closeFile, readFile,   writeFile, truncateFile, syncFile,  sizeOf,
                                      lock,    unlock,    isReserved, control,   sectorSize,   abilities, nullptr,
                                      nullptr, nullptr,   nullptr,    nullptr,   nullptr};

int openFile(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* outFlags) {
  file->pMethods = nullptr;
  if (state->isOff) return SQLITE_CANTOPEN;
  if (!name) return real->xOpen(real, name, file, flags, outFlags);  // a temporary file
  const bool isNewJournal = (flags & (SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL)) && !std::filesystem::exists(name);
  auto* const inner = static_cast<sqlite3_file*>(sqlite3_malloc(real->szOsFile));
  const int code = real->xOpen(real, name, inner, flags, outFlags);
  if (code != SQLITE_OK) {
    sqlite3_free(inner);
    return code;
  }
  auto& content = state->open[name];
  if (!content) content = std::make_shared<Content>(Content{name, readText(name), {}, isNewJournal, ++state->numbered});
  state->removed.erase(name);
  of(file) = {{&kMethods}, content.get(), inner};
  return SQLITE_OK;
}

int removeFile(sqlite3_vfs*, const char* name, int syncsFolder) {
  if (!isOn()) return SQLITE_IOERR_DELETE;
  if (!syncsFolder) state->removed[name] = {readText(name), ++state->numbered};
  return real->xDelete(real, name, syncsFolder);
}

}  // namespace

ForgetfulDisk::ForgetfulDisk(std::mt19937_64& random) {
  state.reset(new State{.random = random, .open = {}, .removed = {}});
  real = sqlite3_vfs_find(nullptr);
  forgetful = *real;
  forgetful.zName = "forgetful";
  forgetful.szOsFile = std::max<int>(real->szOsFile, sizeof(File));
  forgetful.xOpen = openFile;
  forgetful.xDelete = removeFile;
  sqlite3_vfs_register(&forgetful, 1);
}

ForgetfulDisk::~ForgetfulDisk() {
  sqlite3_vfs_unregister(&forgetful);
  sqlite3_vfs_register(real, 1);
  state.reset();
}

void ForgetfulDisk::cutPowerAfter(std::uint64_t operations) { state->untilCut = operations; }
void ForgetfulDisk::cutPower() {
  if (!state->isOff) cutPowerNow();
}
void ForgetfulDisk::fillAfter(std::uint64_t operations) { state->untilFull = operations; }
void ForgetfulDisk::empty() { state->untilFull = kNever; }
void ForgetfulDisk::restorePower() {
  state->isOff = false;
  state->untilCut = state->untilFull = kNever;
}
bool ForgetfulDisk::isOff() const { return state->isOff; }
std::uint64_t ForgetfulDisk::lost() const { return state->lost; }

}  // namespace ridgecast::testing_support
