#include "client/evaluation/view_tables.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <utility>

#include "client/evaluation/text_file.h"
#include "client/evaluation/view_numbers.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;

struct Column {
  std::string title;
  std::function<std::string(const Json& view, const Json& mesh)> cell;
};

// A row for each mesh of each view.
Table tableOf(const char* name, const char* title, const char* note, const std::vector<Json>& views, const std::vector<Column>& columns) {
  Table out{name, title, note, {"view", "refined", "triangles"}, {}};
  for (const Column& c : columns) out.header.push_back(c.title);
  for (const Json& view : views)
    for (const Json& mesh : view.at("meshes")) {
      std::vector<std::string> row{view.at("terrain").get<std::string>() + " " + view.at("view").get<std::string>(),
                                   mesh.at("metric").get<std::string>() + " " + cell("%g", number(mesh, "threshold")),
                                   cell("%.0f", number(mesh, "triangles")) + (mesh.at("settled").get<bool>() ? "" : " (still refining)")};
      for (const Column& c : columns) row.push_back(c.cell(view, mesh));
      out.rows.push_back(std::move(row));
    }
  return out;
}

// SSIM of the filtered picture with one sample; `which`: mesh or corrected.
Column similarityColumn(const char* title, const char* which) {
  return {title, [which](const Json&, const Json& mesh) { return cell("%.4f", ssim(pictureOf(mesh, 1, true), which, "ssim")); }};
}

double timeOf(const Json& mesh, const char* key) { return median(numbers(mesh.at("times"), key)); }
double marchTimeOf(const Json& view, const char* key) { return median(marches(view, key)); }

// Half the range of some times.
std::string spread(const std::vector<double>& values) {
  if (values.empty()) return {};
  const auto [least, greatest] = std::ranges::minmax(values);
  return cell("%.0f", (greatest - least) / 2);
}

Column timeColumn(const char* title, const char* key) {
  return {title, [key](const Json&, const Json& mesh) { return cell("%.0f", timeOf(mesh, key)); }};
}
Column marchTimeColumn(const char* title, const char* key) {
  return {title, [key](const Json& view, const Json&) { return cell("%.0f", marchTimeOf(view, key)); }};
}

Table likeness(const std::vector<Json>& views) {
  std::set<int> samples;
  for (const Json& view : views)
    for (const Json& mesh : view.at("meshes"))
      for (const Json& p : mesh.at("pictures")) samples.insert(p.at("samples").get<int>());
  std::vector<Column> columns;
  for (const bool filtered : {true, false})
    for (const int n : samples)
      for (const char* which : {"mesh", "corrected"}) {
        const std::string side = std::to_string(std::lround(std::sqrt(n)));
        columns.push_back(
            {(filtered ? "filtered, " : "unfiltered, ") + side + "x" + side + ": " + which, [=](const Json&, const Json& mesh) {
               const Json* p = pictureOf(mesh, n, filtered);
               const std::string terrain = cell("%.4f", ssim(p, which, "terrain"));
               return cell("%.4f", ssim(p, which, "ssim")) + (terrain.empty() ? "" : " (" + terrain + ")");
             }});
      }
  return tableOf("likeness", "Likeness of the settled mesh",
                 "SSIM of settled meshes, as they are and corrected onto the true surface, against the converged ray march of the same "
                 "camera; in brackets: windows that see terrain alone. Filtered: both are shaded by each sample's footprint.",
                 views, columns);
}

Table corrected(const std::vector<Json>& views) {
  const auto pixelErrors = [](const char* title, const char* key) {
    return Column{title, [key](const Json&, const Json& mesh) {
                    return cell("%.3f", number(mesh.at(key), "median")) + " / " + cell("%.2f", number(mesh.at(key), "p99"));
                  }};
  };
  const auto cost = [](const char* title, const char* own, const char* march) {
    return Column{title, [=](const Json& view, const Json& mesh) { return cell("%.3f", timeOf(mesh, own) / marchTimeOf(view, march)); }};
  };
  return tableOf(
      "corrected", "The mesh corrected along each ray: likeness and cost",
      "Three heights a sample move the mesh's samples onto the true surface (window and page show it so: it hides the mesh's errors). "
      "Filtered, one sample; drawn in turn in one run, medians.",
      views,
      {similarityColumn("SSIM mesh", "mesh"), similarityColumn("SSIM corrected", "corrected"), timeColumn("mesh ms", "mesh_ms"),
       timeColumn("corrected ms", "corrected_ms"), marchTimeColumn("ray march ms", "march_ms"),
       cost("cost, of the march", "corrected_ms", "march_ms"), cost("of its CPU time", "corrected_cpu_ms", "march_cpu_ms"),
       pixelErrors("off by, mesh: median / p99 px", "pixel_error"), pixelErrors("corrected: median / p99 px", "pixel_error_corrected")});
}

Table steps(const std::vector<Json>& views) {
  std::vector<Column> columns{similarityColumn("mesh alone", "mesh")};
  const Json& first = views.front().at("meshes").at(0).at("correction");
  for (std::size_t k = 0; k < first.size(); ++k)
    columns.push_back({cell("%.0f", number(first[k], "steps")) + (first[k].at("steps") == 1 ? " step" : " steps"),
                       [k](const Json&, const Json& mesh) { return cell("%.4f", number(mesh.at("correction").at(k), "ssim")); }});
  return tableOf("steps", "The correction by its steps", "One height for each step and sample. SSIM, filtered, one sample.", views,
                 columns);
}

Table missing(const std::vector<Json>& views) {
  std::vector<Column> columns;
  for (const auto& [title, key] : {std::pair("1 - SSIM", "total"),
                                   {"silhouettes", "silhouettes"},
                                   {"geometry", "geometry"},
                                   {"shading", "shading"},
                                   {"marcher", "marcher"}})
    columns.push_back({title, [key = key](const Json&, const Json& mesh) { return cell("%.4f", number(mesh.at("missing"), key)); }});
  columns.push_back({"windows at silhouettes", [](const Json&, const Json& mesh) {
                       return cell("%.1f %%", 100 * number(mesh.at("missing"), "silhouette_windows"));
                     }});
  return tableOf("missing", "Sources of error",
                 "1 - SSIM, filtered, one sample, and its parts. Silhouettes: windows where mesh and march see different ground. In the "
                 "other windows, geometry is what disappears when every sample of the mesh is moved onto the true surface, and shading is "
                 "what remains (equal ground, different colours). Marcher: the ray march against one with half its steps.",
                 views, columns);
}

Table speed(const std::vector<Json>& views) {
  const auto faster = [](const char* title, const char* own, const char* march) {
    return Column{title, [=](const Json& view, const Json& mesh) { return cell("%.1f", marchTimeOf(view, march) / timeOf(mesh, own)); }};
  };
  return tableOf("speed", "Mesh against ray march: time of a picture",
                 "Filtered, one sample, drawn in turn in one run; medians and half the range. Both shade every sample alike; the ray march "
                 "is the converged reference. CPU: time of all threads of the process, independent of other programs; on a software "
                 "driver this is the cost.",
                 views,
                 {similarityColumn("SSIM", "mesh"),
                  timeColumn("mesh ms", "mesh_ms"),
                  {"spread", [](const Json&, const Json& mesh) { return spread(numbers(mesh.at("times"), "mesh_ms")); }},
                  marchTimeColumn("ray march ms", "march_ms"),
                  {"spread", [](const Json& view, const Json&) { return spread(marches(view, "march_ms")); }},
                  faster("faster by", "mesh_ms", "march_ms"),
                  timeColumn("mesh CPU ms", "mesh_cpu_ms"),
                  marchTimeColumn("ray march CPU ms", "march_cpu_ms"),
                  faster("faster by CPU", "mesh_cpu_ms", "march_cpu_ms")});
}

}  // namespace

Outcome<std::vector<Json>> readViews(std::span<const std::filesystem::path> folders) {
  std::vector<Json> views;
  for (const std::filesystem::path& folder : folders) {
    const std::filesystem::path file = folder / "view.json";
    Json view = Json::parse(readText(file), nullptr, false);
    if (!view.is_object() || !view.contains("meshes")) return Error{file.string() + " is broken; remove its folder to measure it again"};
    views.push_back(std::move(view));
  }
  return views;
}

std::vector<Table> viewTables(const std::vector<Json>& views) {
  if (views.empty()) return {};
  return {likeness(views), missing(views), speed(views), corrected(views), steps(views)};
}

}  // namespace ridgecast::evaluation
