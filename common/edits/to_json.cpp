#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/edits/json.h"
#include "common/text/text.h"

namespace ridgecast::edits {
namespace {

std::string number(double value) {
  std::string out = text::rounded(value, 17);
  return out.find_first_of(".e") == std::string::npos ? out + ".0" : out;
}
std::string metres(lattice::Step steps) { return number(lattice::metres(steps)); }
std::string share(std::uint32_t of256) { return number(of256 / 256.0); }
std::string quoted(const char* text) { return '"' + std::string(text) + '"'; }  // of names alone: nothing is escaped

template <class Range, class Write>
std::string list(const Range& range, const Write& write) {
  std::string out = "[";
  for (const auto& one : range) out += (out.size() > 1 ? "," : "") + write(one);
  return out + ']';
}

using Members = std::vector<std::pair<const char*, std::string>>;

struct Writer {
  Members operator()(const Raise& o) const {
    return {{"op", quoted(o.amount < 0 ? "lower" : "raise")},
            {"x", metres(o.at.x)},
            {"z", metres(o.at.z)},
            {"radius", metres(o.radius)},
            {"core", metres(o.core)},
            {"by", metres(std::abs(o.amount))}};
  }
  Members operator()(const Crater& o) const {
    return {
        {"op", quoted("crater")}, {"x", metres(o.at.x)}, {"z", metres(o.at.z)}, {"radius", metres(o.radius)}, {"depth", metres(o.depth)}};
  }
  Members operator()(const Level& o) const {
    Members out{{"op", quoted("level")}, {"height", metres(o.height)}, {"slope", share(o.slope)}};
    if (o.corners.size() != 1)
      out.emplace_back("polygon", list(o.corners, [](lattice::Point p) { return '[' + metres(p.x) + ',' + metres(p.z) + ']'; }));
    else
      out.insert(out.end(), {{"x", metres(o.corners[0].x)}, {"z", metres(o.corners[0].z)}, {"radius", metres(o.radius)}});
    return out;
  }
  Members operator()(const Smooth& o) const {
    return {{"op", quoted("smooth")},
            {"x", metres(o.at.x)},
            {"z", metres(o.at.z)},
            {"radius", metres(o.radius)},
            {"passes", std::to_string(o.passes)}};
  }
  Members operator()(const Road& o) const {
    const auto station = [&](const lattice::Vertex& v) {
      return '[' + metres(v.x) + ',' + metres(v.z) + (o.surveyed ? ',' + metres(v.y) : "") + ']';
    };
    return {{"op", quoted("road")},
            {"width", metres(o.width)},
            {"grade", share(o.grade)},
            {"slope", share(o.slope)},
            {"line", list(o.line, station)}};
  }
  Members operator()(const Stamp& o) const {
    return {{"op", quoted("stamp")},
            {"x", metres(o.at.x)},
            {"z", metres(o.at.z)},
            {"spacing", metres(o.spacing * kPostSteps)},
            {"columns", std::to_string(o.width)},
            {"samples", list(o.samples, [](std::int32_t v) { return metres(v); })}};
  }
  Members operator()(const Undo& o) const { return {{"op", quoted("undo")}, {"edit", std::to_string(o.edit)}}; }
};

}  // namespace

std::string toJson(const Operation& operation) {
  Members members = std::visit(Writer(), operation.what);
  if (operation.material > 0) members.emplace_back("material", quoted(terrain::kMaterials[operation.material - 1]));
  std::ranges::sort(members, {}, [](const auto& member) { return std::string_view(member.first); });
  std::string out;
  for (const auto& [name, value] : members) out += (out.empty() ? '{' : ',') + quoted(name) + ':' + value;
  return out + '}';
}

}  // namespace ridgecast::edits
