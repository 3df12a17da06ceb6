#include "server/recording/merged.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <utility>
#include <variant>

#include "common/text/text.h"

namespace ridgecast::recording {

namespace {

std::uint64_t editHash(const Edited& edited) {
  return std::hash<std::string>()(edited.operation) * 31 + std::hash<std::string>()(edited.author);
}

}  // namespace

Outcome<std::unique_ptr<Records>> openRecords(const std::vector<Parts>& recordings) {
  if (recordings.size() > 1) return Merged::open(recordings);
  auto reader = Reader::open(recordings.at(0));
  if (!reader) return reader.error();
  return std::unique_ptr<Records>(std::move(*reader));
}

Outcome<std::unique_ptr<Records>> Merged::open(const std::vector<Parts>& recordings) {
  std::unique_ptr<Merged> merged(new Merged);
  std::int64_t began = std::numeric_limits<std::int64_t>::max();
  for (const Parts& parts : recordings) {
    auto reader = Reader::open(parts);
    if (!reader) return reader.error();
    began = std::min(began, (*reader)->world().began);
    merged->sources_.push_back({parts.front().string(), std::move(*reader)});
  }
  merged->world_ = merged->sources_.front().reader->world();
  for (Source& source : merged->sources_) {
    World world = source.reader->world();
    source.offset = world.began - began;
    world.server = merged->world_.server;
    world.began = merged->world_.began;
    if (world != merged->world_)
      return Error{"'" + merged->sources_.front().name + "' and '" + source.name +
                   "' are recordings of different sessions or worlds; those of one session from several servers are taken together."};
    source.head = source.reader->next();
  }
  merged->world_.began = began;
  return std::unique_ptr<Records>(std::move(merged));
}

bool Merged::wasCutOff() const {
  return std::ranges::any_of(sources_, [](const Source& source) { return source.reader->wasCutOff(); });
}

Merged::Source* Merged::earliest() {
  Source* first = nullptr;
  for (Source& source : sources_)
    if (source.head && (!first || source.head->time + source.offset < first->head->time + first->offset)) first = &source;
  return first;
}

void Merged::advance(Source& source) {
  source.head = source.reader->next();
  if (source.head) return;
  if (damage_.empty()) damage_ = source.reader->damage();
  for (const auto& [camera, of] : cameras_)
    if (of == &source) left_.push_back({time_, Left{camera}});
}

bool Merged::isClock(const Source& source) const {
  for (const Source& other : sources_)
    if (&other == &source || (other.head && other.offset <= time_)) return &other == &source;
  return false;
}

bool Merged::refuse(const std::string& why) {
  damage_ = "At " + text::rounded(seconds(), 6) + " s: " + why;
  return false;
}

bool Merged::admit(const Source& source, const Record& record) {
  if (std::holds_alternative<Clocked>(record.event)) return isClock(source);
  if (const auto* edited = std::get_if<Edited>(&record.event)) {
    if (edited->number == edits_.size() + 1) return edits_.push_back(editHash(*edited)), true;
    const std::string edit = "Edit " + std::to_string(edited->number);
    if (edited->number > edits_.size())
      return refuse(edit + " follows edit " + std::to_string(edits_.size()) + " in '" + source.name + "'.");
    if (edits_[edited->number - 1] == editHash(*edited)) return false;
    return refuse(edit + " is another one in '" + source.name + "' than in a recording before it: they are not of one session.");
  }
  if (const auto* joined = std::get_if<Joined>(&record.event)) {
    const auto [at, isNew] = cameras_.emplace(joined->camera, &source);
    if (!isNew && at->second != &source)
      return refuse("Camera " + std::to_string(joined->camera) + " is in '" + at->second->name + "' and '" + source.name +
                    "' at the same time: they are not of one session.");
  }
  if (const auto* left = std::get_if<Left>(&record.event)) cameras_.erase(left->camera);
  return true;
}

std::optional<Record> Merged::next() {
  while (damage_.empty()) {
    if (!left_.empty()) {
      Record left = std::move(left_.front());
      left_.pop_front();
      cameras_.erase(std::get<Left>(left.event).camera);
      return left;
    }
    Source* const source = earliest();
    if (!source) return {};
    Record record = std::move(*source->head);
    record.time += source->offset;
    time_ = std::max(time_, record.time);
    record.time = time_;
    const bool isNew = admit(*source, record);
    advance(*source);
    if (isNew) return record;
  }
  return {};
}

}  // namespace ridgecast::recording
