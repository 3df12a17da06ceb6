#include "client/viewer/remembered.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "client/viewer/controls.h"
#include "client/viewer/coordinates.h"
#include "common/text/file.h"

namespace ridgecast::viewer {
namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr std::size_t kMaxBytes = 64 * 1024;
// Of Mode and Borders, in their order.
constexpr std::array<const char*, 4> kModes = {"split", "mesh", "march", "difference"};
constexpr std::array<const char*, 3> kBorders = {"none", "level", "age"};

// Reads fields of an object that may hold anything; keeps the first complaint.
class Reader {
 public:
  explicit Reader(const OrderedJson& object) : object_(object) {}
  template <class Number>
  void number(const char* name, Number& out, double least, double most) {
    const OrderedJson* const value = find(name);
    if (!value) return;
    const double number = value->is_number() ? value->get<double>() : most + 1;
    if (!(number >= least && number <= most)) return complain(name, "a number from " + text(least) + " to " + text(most));
    out = static_cast<Number>(number);
  }
  void flag(const char* name, bool& out) {
    const OrderedJson* const value = find(name);
    if (value && !value->is_boolean()) return complain(name, "true or false");
    if (value) out = value->get<bool>();
  }
  template <class Enum, std::size_t n>
  void choice(const char* name, Enum& out, const std::array<const char*, n>& names) {
    const OrderedJson* const value = find(name);
    if (!value) return;
    const auto found = std::ranges::find_if(names, [value](const char* one) { return *value == one; });
    if (found == names.end()) return complain(name, std::string("one of its words, such as ") + names.front());
    out = static_cast<Enum>(found - names.begin());
  }
  void words(const char* name, std::string& out, std::size_t most) {
    const OrderedJson* const value = find(name);
    if (value && (!value->is_string() || value->get_ref<const std::string&>().size() > most))
      return complain(name, "a text of at most " + std::to_string(most) + " bytes");
    if (value) out = value->get<std::string>();
  }
  void metres(const char* name, lattice::Step& out) {
    std::string digits;
    words(name, digits, 40);
    const auto read = parseMetres(digits);
    if (!read) return complain(name, "a number of metres, as text");
    out = *read;
  }
  const std::string& problem() const { return problem_; }

 private:
  static std::string text(double number) { return OrderedJson(number).dump(); }
  const OrderedJson* find(const char* name) const {
    const auto found = object_.find(name);
    return found == object_.end() ? nullptr : &*found;
  }
  void complain(const char* name, const std::string& right) {
    if (problem_.empty()) problem_ = std::string("'") + name + "' should be " + right;
  }
  const OrderedJson& object_;
  std::string problem_;
};

class Writer {
 public:
  template <class Number>
  void number(const char* name, const Number& value, double, double) {
    object[name] = value;
  }
  void flag(const char* name, bool value) { object[name] = value; }
  template <class Enum, std::size_t n>
  void choice(const char* name, Enum value, const std::array<const char*, n>& names) {
    object[name] = names.at(static_cast<std::size_t>(value));
  }
  void words(const char* name, const std::string& value, std::size_t) { object[name] = value; }
  void metres(const char* name, lattice::Step value) { object[name] = formatMetres(value); }
  OrderedJson object = OrderedJson::object();
};

template <class Visitor, class R>
void visitFields(Visitor& v, R& r) {
  v.number("width", r.width, 100, 16384);
  v.number("height", r.height, 100, 16384);
  v.number("text-scale", r.textScale, 0.5, 4);
  v.number("divider", r.divider, 0.02, 0.98);
  v.number("speed", r.speed, kSlowest, kFastest);
  v.choice("mode", r.mode, kModes);
  v.choice("leaves", r.borders, kBorders);
  v.flag("figures", r.figures);
  v.flag("plots", r.plots);
  v.flag("wireframe", r.wireframe);
  v.flag("smooth", r.smooth);
  v.flag("invert-y", r.invertY);
  v.flag("vsync", r.vsync);
  v.flag("members", r.members);
  v.words("name", r.name, 32);
}

template <class Visitor, class P>
void visitPlace(Visitor& v, P& p) {
  v.words("where", p.where, 400);
  v.metres("x", p.at.x);
  v.metres("z", p.at.z);
  v.number("altitude", p.altitude, 1, 100000);
  v.number("yaw", p.yaw, -360, 360);
  v.number("pitch", p.pitch, -89, 89);
}

OrderedJson objectOf(const Remembered& remembered) {
  Writer writer;
  visitFields(writer, remembered);
  OrderedJson places = OrderedJson::array();
  for (const Remembered::Place& place : remembered.places) {
    Writer one;
    visitPlace(one, place);
    places.push_back(std::move(one.object));
  }
  writer.object["places"] = std::move(places);
  return std::move(writer.object);
}

Outcome<Remembered> rememberedFrom(const OrderedJson& json) {
  if (!json.is_object()) return Error{"it is not a JSON object"};
  Remembered out;
  Reader reader(json);
  visitFields(reader, out);
  if (!reader.problem().empty()) return Error{reader.problem()};
  const auto places = json.find("places");
  if (places == json.end()) return out;
  if (!places->is_array() || places->size() > Remembered::kMaxPlaces)
    return Error{"'places' should be a list of at most " + std::to_string(Remembered::kMaxPlaces)};
  for (const OrderedJson& entry : *places) {
    Remembered::Place place;
    Reader one(entry);
    if (entry.is_object()) visitPlace(one, place);
    if (place.where.empty() || !one.problem().empty())
      return Error{"in 'places', " + (one.problem().empty() ? "'where' is missing" : one.problem())};
    out.places.push_back(std::move(place));
  }
  return out;
}

Outcome<void> replace(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path unfinished = file.string() + "." + std::to_string(getpid()) + ".part";
  std::error_code failed;
  std::filesystem::create_directories(file.parent_path(), failed);
  std::ofstream out(unfinished, std::ios::binary | std::ios::trunc);
  out << text;
  out.close();
  if (out) std::filesystem::rename(unfinished, file, failed);
  if (out && !failed) return {};
  std::filesystem::remove(unfinished, failed);
  return Error{"the window's settings cannot be kept in " + file.string() + ": it should be a file in a folder that may be written"};
}

}  // namespace

const Remembered::Place* Remembered::placeAt(const std::string& where) const {
  const auto found = std::ranges::find(places, where, &Place::where);
  return found == places.end() ? nullptr : &*found;
}

void Remembered::visit(Place place) {
  std::erase_if(places, [&](const Place& other) { return other.where == place.where; });
  places.insert(places.begin(), std::move(place));
  if (places.size() > kMaxPlaces) places.pop_back();
}

std::string sessionAt(const core::Url& url) { return url.host + ":" + url.port + "/" + url.session; }

std::optional<std::filesystem::path> rememberedFile() {
  const auto folder = [](const char* variable) { return std::filesystem::path(std::getenv(variable) ? std::getenv(variable) : ""); };
  std::filesystem::path base = folder("XDG_CONFIG_HOME");
  if (!base.is_absolute()) base = folder("HOME") / ".config";
  if (!base.is_absolute()) return std::nullopt;
  return base / "ridgecast" / "window.json";
}

Outcome<Remembered> readRemembered(const std::filesystem::path& file) {
  std::error_code failed;
  const auto status = std::filesystem::status(file, failed);
  if (status.type() == std::filesystem::file_type::not_found) return Remembered{};
  const auto wrong = [&file](const std::string& why) { return Error{"what is remembered in " + file.string() + " is ignored: " + why}; };
  if (!std::filesystem::is_regular_file(status)) return wrong("it is not a file that can be read");
  const auto text = text::readFile(file, kMaxBytes);
  if (!text) return wrong("it is not a file that can be read");
  if (text->size() > kMaxBytes) return wrong("it is larger than 64 KiB");
  const OrderedJson json = OrderedJson::parse(*text, nullptr, false);
  auto read = json.is_discarded() ? Outcome<Remembered>(Error{"it is not JSON"}) : rememberedFrom(json);
  if (!read) return wrong(read.error().message);
  return read;
}

Outcome<void> keepChanges(const std::filesystem::path& file, const Remembered& first, const Remembered& last) {
  auto read = readRemembered(file);
  Remembered held = read ? std::move(*read) : Remembered{};
  for (auto place = last.places.rbegin(); place != last.places.rend(); ++place) held.visit(*place);
  const OrderedJson before = objectOf(first), after = objectOf(last);
  OrderedJson json = objectOf(held);
  for (const auto& [name, value] : after.items())
    if (name != "places" && value != before[name]) json[name] = value;
  return replace(file, json.dump(2, ' ', false, OrderedJson::error_handler_t::replace) + "\n");
}

}  // namespace ridgecast::viewer
