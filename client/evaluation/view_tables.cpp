#include "client/evaluation/view_tables.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "client/evaluation/text_file.h"
#include "client/evaluation/view_numbers.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;

double halfRange(const std::vector<double>& sorted) { return sorted.empty() ? kNothing : (sorted.back() - sorted.front()) / 2; }

std::vector<std::string> nameOf(const Json& view, const Json& mesh) {
  return {view.at("terrain").get<std::string>() + " " + view.at("view").get<std::string>(),
          mesh.at("metric").get<std::string>() + " " + cell("%g", number(mesh, "threshold")),
          cell("%.0f", number(mesh, "triangles")) + (mesh.at("settled").get<bool>() ? "" : " (still refining)")};
}

const std::vector<std::string> kName = {"view", "refined", "triangles"};

std::vector<std::string> joined(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

template <class Row>
void eachMesh(const std::vector<Json>& views, Table& table, const Row& row) {
  for (const Json& view : views)
    for (const Json& mesh : view.at("meshes")) table.rows.push_back(joined(nameOf(view, mesh), row(view, mesh)));
}

Table likeness(const std::vector<Json>& views, const char* which, const char* title, const char* name) {
  std::vector<int> samples;
  for (const Json& view : views)
    for (const Json& mesh : view.at("meshes"))
      for (const Json& p : mesh.at("pictures"))
        if (std::ranges::find(samples, p.at("samples").get<int>()) == samples.end()) samples.push_back(p.at("samples").get<int>());
  std::ranges::sort(samples);
  Table out{name,
            title,
            "SSIM of settled meshes against the converged ray march of the same camera; in brackets on windows that see terrain alone. "
            "Filtered: both shaded by each sample's footprint.",
            kName,
            {}};
  for (const bool filtered : {true, false})
    for (const int n : samples) {
      const int side = static_cast<int>(std::lround(std::sqrt(n)));
      out.header.push_back((filtered ? "filtered, " : "unfiltered, ") + std::to_string(side) + "x" + std::to_string(side));
    }
  eachMesh(views, out, [&](const Json&, const Json& mesh) {
    std::vector<std::string> cells;
    for (const bool filtered : {true, false})
      for (const int n : samples) {
        const Json* p = pictureOf(mesh, n, filtered);
        const std::string terrain = cell("%.4f", ssim(p, which, "terrain"));
        cells.push_back(cell("%.4f", ssim(p, which, "ssim")) + (terrain.empty() ? "" : " (" + terrain + ")"));
      }
    return cells;
  });
  return out;
}

Table corrected(const std::vector<Json>& views) {
  Table out{"corrected",
            "The mesh corrected along each ray: likeness and cost",
            "Three heights a sample move what the mesh shows onto the true surface (a mode of its own: it hides what the mesh lacks). "
            "Filtered, one sample; times in one run in turn, medians.",
            joined(kName, {"SSIM mesh", "SSIM corrected", "mesh ms", "corrected ms", "ray march ms", "cost, of the march",
                           "of its CPU time", "off by, mesh: median / p99 px", "corrected: median / p99 px"}),
            {}};
  eachMesh(views, out, [&](const Json& view, const Json& mesh) {
    const Json* p = pictureOf(mesh, 1, true);
    const Json& times = mesh.at("times");
    const double own = median(numbers(times, "corrected_ms")), march = median(marches(view, "march_ms"));
    const auto off = [&](const char* key) {
      return cell("%.3f", number(mesh.at(key), "median")) + " / " + cell("%.2f", number(mesh.at(key), "p99"));
    };
    return std::vector<std::string>{cell("%.4f", ssim(p, "mesh", "ssim")),
                                    cell("%.4f", ssim(p, "corrected", "ssim")),
                                    cell("%.0f", median(numbers(times, "mesh_ms"))),
                                    cell("%.0f", own),
                                    cell("%.0f", march),
                                    cell("%.3f", own / march),
                                    cell("%.3f", median(numbers(times, "corrected_cpu_ms")) / median(marches(view, "march_cpu_ms"))),
                                    off("pixel_error"),
                                    off("pixel_error_corrected")};
  });
  return out;
}

Table steps(const std::vector<Json>& views) {
  Table out{"steps", "The correction by its steps", "One height a step and sample; SSIM filtered, one sample.", kName, {}};
  out.header.push_back("mesh alone");
  bool titled = false;
  eachMesh(views, out, [&](const Json&, const Json& mesh) {
    std::vector<std::string> cells{cell("%.4f", ssim(pictureOf(mesh, 1, true), "mesh", "ssim"))};
    for (const Json& s : mesh.at("correction")) {
      if (!titled) out.header.push_back(cell("%.0f", number(s, "steps")) + (s.at("steps") == 1 ? " step" : " steps"));
      cells.push_back(cell("%.4f", number(s, "ssim")));
    }
    titled = true;
    return cells;
  });
  return out;
}

Table missing(const std::vector<Json>& views) {
  Table out{"missing",
            "What is missing, and where from",
            "1 - SSIM, filtered, one sample, and its parts. Silhouettes: windows in which mesh and march see different ground somewhere. "
            "Elsewhere: "
            "geometry is what goes "
            "when every sample of the mesh is moved onto the true surface; shading what stays then (equal ground, unlike colours); marcher "
            "what the ray "
            "march differs by from one of half its steps.",
            joined(kName, {"1 - SSIM", "silhouettes", "geometry", "shading", "marcher", "windows at silhouettes"}),
            {}};
  eachMesh(views, out, [&](const Json&, const Json& mesh) {
    const Json& m = mesh.at("missing");
    std::vector<std::string> cells;
    for (const char* key : {"total", "silhouettes", "geometry", "shading", "marcher"}) cells.push_back(cell("%.4f", number(m, key)));
    cells.push_back(cell("%.1f %%", 100 * number(m, "silhouette_windows")));
    return cells;
  });
  return out;
}

Table speed(const std::vector<Json>& views) {
  Table out{
      "speed",
      "Mesh against ray march: time of a picture",
      "Filtered, one sample, drawn in turn in one run; medians and half the range. Both shade every sample alike; the ray march is "
      "the converged one that the mesh is compared with. CPU: of all threads of the process, which other programs on the machine do not "
      "change; on a software driver that is the cost.",
      joined(kName,
             {"SSIM", "mesh ms", "spread", "ray march ms", "spread", "faster by", "mesh CPU ms", "ray march CPU ms", "faster by CPU"}),
      {}};
  eachMesh(views, out, [&](const Json& view, const Json& mesh) {
    const Json& times = mesh.at("times");
    const std::vector<double> own = numbers(times, "mesh_ms"), march = marches(view, "march_ms");
    const double ownCpu = median(numbers(times, "mesh_cpu_ms")), marchCpu = median(marches(view, "march_cpu_ms"));
    return std::vector<std::string>{cell("%.4f", ssim(pictureOf(mesh, 1, true), "mesh", "ssim")),
                                    cell("%.0f", median(own)),
                                    cell("%.0f", halfRange(own)),
                                    cell("%.0f", median(march)),
                                    cell("%.0f", halfRange(march)),
                                    cell("%.1f", median(march) / median(own)),
                                    cell("%.0f", ownCpu),
                                    cell("%.0f", marchCpu),
                                    cell("%.1f", marchCpu / ownCpu)};
  });
  return out;
}

}  // namespace

Outcome<std::vector<Json>> readViews(std::span<const std::filesystem::path> folders) {
  std::vector<Json> views;
  for (const std::filesystem::path& folder : folders) {
    const std::filesystem::path file = folder / "view.json";
    Json view = Json::parse(readText(file), nullptr, false);
    if (!view.is_object() || !view.contains("meshes"))
      return Error{file.string() + " is broken: remove its folder, and it is measured again"};
    views.push_back(std::move(view));
  }
  return views;
}

std::vector<Table> viewTables(const std::vector<Json>& views) {
  if (views.empty()) return {};
  return {likeness(views, "mesh", "Likeness of the settled mesh", "likeness"),
          missing(views),
          speed(views),
          corrected(views),
          likeness(views, "corrected", "Likeness of the corrected mesh", "likeness-corrected"),
          steps(views)};
}

}  // namespace ridgecast::evaluation
