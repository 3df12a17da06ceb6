#include "server/recording/reader.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <system_error>
#include <utility>

#include "common/text/text.h"

namespace ridgecast::recording {

namespace fs = std::filesystem;

std::string partName(const std::string& name, unsigned part) {
  std::array<char, 16> number{};
  std::snprintf(number.data(), number.size(), ".%04u", part);
  return name + number.data() + std::string(kExtension);
}

std::optional<std::pair<std::string, unsigned>> nameOf(const fs::path& file) {
  std::string name = file.filename().string();
  if (!name.ends_with(kExtension)) return {};
  name.resize(name.size() - kExtension.size());
  const std::size_t dot = name.rfind('.');
  if (dot == name.npos || dot == 0) return {};
  const auto part = text::number<unsigned>(std::string_view(name).substr(dot + 1));
  if (!part) return {};
  return std::pair(name.substr(0, dot), *part);
}

Outcome<std::vector<Parts>> recordingsAt(const fs::path& path) {
  std::error_code failed;
  const bool isFolder = fs::is_directory(path, failed);
  if (!isFolder && !fs::exists(path, failed)) return Error{"There is no file or folder '" + path.string() + "'."};
  const auto own = isFolder ? std::nullopt : nameOf(path);
  if (!isFolder && !own) return std::vector<Parts>(1, Parts(1, path));  // whatever its name is
  std::map<std::string, std::map<unsigned, fs::path>> found;
  for (const auto& entry : fs::directory_iterator(isFolder ? path : path.has_parent_path() ? path.parent_path() : ".", failed))
    if (auto name = nameOf(entry.path());
        name && name->second != kEditsPart && (!own || (name->first == own->first && name->second >= own->second)))
      found[name->first][name->second] = entry.path();
  std::vector<Parts> out;
  for (auto& [name, parts] : found) {
    auto& files = out.emplace_back();
    for (auto& [number, file] : parts) files.push_back(std::move(file));
  }
  if (out.empty()) return Error{"There is no recording (NAME.0001" + std::string(kExtension) + ") in '" + path.string() + "'."};
  return out;
}

// ---- blocks ----

struct Blocks::State {
  std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context{ZSTD_createDCtx(), ZSTD_freeDCtx};
  std::array<char, 65'536> read{};
  ZSTD_inBuffer in{read.data(), 0, 0};
  Bytes block;
};

Blocks::Blocks(std::istream& in) : in_(in), state_(std::make_unique<State>()) {
  ZSTD_DCtx_setParameter(state_->context.get(), ZSTD_d_windowLogMax, 22);  // kMaxBlockBytes
}
Blocks::~Blocks() = default;

std::optional<std::span<const std::uint8_t>> Blocks::next() {
  if (!problem_.empty()) return {};
  State& s = *state_;
  Bytes& block = s.block;
  block.clear();
  std::size_t size = 0;
  for (bool begun = false;;) {
    if (s.in.pos == s.in.size) {
      in_.read(s.read.data(), static_cast<std::streamsize>(s.read.size()));
      s.in = {s.read.data(), static_cast<std::size_t>(in_.gcount()), 0};
      if (s.in.size == 0) {
        if (begun) problem_ = "Its last block was not written in whole.", wasCutOff_ = true;
        return {};
      }
    }
    begun = true;
    if (size == block.size()) block.resize(std::min(kMaxBlockBytes, std::max<std::size_t>(65'536, 2 * size)));
    ZSTD_outBuffer out{block.data(), block.size(), size};
    const std::size_t left = ZSTD_decompressStream(s.context.get(), &out, &s.in);
    size = out.pos;
    if (ZSTD_isError(left) || (left > 0 && size == kMaxBlockBytes)) {
      problem_ = "A block of it is damaged.";
      return {};
    }
    if (left == 0) return std::span<const std::uint8_t>(block.data(), size);
  }
}

// ---- records ----

struct Reader::Part {
  explicit Part(const fs::path& path) : file(path, std::ios::binary), blocks(file) {}
  // Error with an empty message: it is over.
  Outcome<Record> next() {
    while (block.empty()) {
      const auto read = blocks.next();
      if (!read) return Error{blocks.problem()};
      block = *read;
    }
    return decoder.next(block);
  }
  std::ifstream file;
  Blocks blocks;
  Decoder decoder;
  std::span<const std::uint8_t> block;
};

Reader::Reader(Parts parts) : parts_(std::move(parts)) {}
Reader::~Reader() = default;

Outcome<std::unique_ptr<Reader>> Reader::open(Parts parts) {
  const std::string first = parts.front().string();
  std::unique_ptr<Reader> reader(new Reader(std::move(parts)));
  if (!reader->openNext()) return Error{"Cannot read '" + first + "'."};
  const auto record = reader->part_->next();
  const World* world = record ? std::get_if<World>(&record->event) : nullptr;
  if (!world) return Error{"'" + first + "' is not a recording of this version of Ridgecast, or has nothing whole in it."};
  reader->world_ = *world;
  return reader;
}

bool Reader::openNext() {
  if (opened_ == parts_.size()) return false;
  part_ = std::make_unique<Part>(parts_[opened_++]);
  return part_->file.is_open();
}

Outcome<Record> Reader::nextKept() {
  const auto name = nameOf(parts_[opened_ - 1]);
  const fs::path file = parts_[opened_ - 1].parent_path() / (name ? partName(name->first, kEditsPart) : "");
  const Error missing{"The edits before it are not there, or not whole: " +
                      (name ? "'" + file.string() + "' belongs beside it." : "a recording's files must keep their names.")};
  if (!kept_) {
    kept_ = std::make_unique<Part>(file);
    const auto begins = kept_->next();
    if (!name || !begins || !(begins->event == Event(world_))) return missing;
  }
  for (;;) {
    auto record = kept_->next();
    const auto* edited = record ? std::get_if<Edited>(&record->event) : nullptr;
    if (!edited || edited->number > lastEdit_ + 1) return missing;
    if (edited->number == lastEdit_ + 1) return record;
  }
}

std::optional<Record> Reader::next() {
  const auto stop = [&](const std::string& why) {
    damage_ = parts_[opened_ - 1].string() + ": " + why + " What follows " + text::rounded(seconds(), 6) + " s is not read.";
    return std::nullopt;
  };
  while (damage_.empty() && !wasCutOff_) {
    if (lastEdit_ < keptUntil_.number) {
      auto record = nextKept();
      if (!record) return stop(record.error().message);
      record->time = time_;
      ++lastEdit_;
      return std::move(*record);
    }
    kept_ = nullptr;
    Outcome<Record> record = part_->next();
    if (!record) {
      const bool isLast = opened_ == parts_.size();
      if (part_->blocks.wasCutOff() && isLast)
        wasCutOff_ = true;
      else if (!record.error().message.empty())
        return stop(record.error().message);
      if (isLast) return {};
      if (!openNext()) return stop("The file cannot be read.");
      const auto begins = part_->next();
      if (!begins && opened_ == parts_.size() && (begins.error().message.empty() || part_->blocks.wasCutOff())) {
        wasCutOff_ = true;  // nothing whole is in it yet
        continue;
      }
      if (!begins || !(begins->event == Event(world_))) return stop("It does not continue the part before it.");
      continue;
    }
    if (const auto* before = std::get_if<EditsBefore>(&record->event)) {
      keptUntil_ = *before;
      time_ = record->time;
      continue;
    }
    if (opened_ > 1) {  // what a later part repeats
      if (const auto* joined = std::get_if<Joined>(&record->event); joined && joined->again) continue;
      if (const auto* edited = std::get_if<Edited>(&record->event); edited && edited->number <= lastEdit_) continue;
      if (clock_ == *record) continue;
    }
    if (const auto* edited = std::get_if<Edited>(&record->event)) lastEdit_ = edited->number;
    if (std::holds_alternative<Clocked>(record->event)) clock_ = *record;
    time_ = record->time;
    return std::move(*record);
  }
  return {};
}

}  // namespace ridgecast::recording
