#include "client/evaluation/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ridgecast::evaluation {

std::string escapedHtml(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '<' ? "&lt;" : c == '&' ? "&amp;" : c == '"' ? "&quot;" : std::string(1, c);
  return out;
}

std::string asHtml(const Table& table) {
  std::string out = "<h3>" + escapedHtml(table.title) + "</h3>\n";
  if (!table.note.empty()) out += "<p>" + escapedHtml(table.note) + "</p>\n";
  out += "<div class=\"wide\"><table><tr>";
  for (const std::string& title : table.header) out += "<th>" + escapedHtml(title);
  for (const auto& row : table.rows) {
    out += "\n<tr>";
    for (const std::string& text : row) out += "<td>" + escapedHtml(text);
  }
  return out + "\n</table></div>\n";
}

std::string asMarkdown(const Table& table) {
  const auto line = [](const std::vector<std::string>& cells) {
    std::string out = "|";
    for (const std::string& text : cells) out += " " + text + " |";
    return out + "\n";
  };
  std::string out = "## " + table.title + "\n\n";
  if (!table.note.empty()) out += table.note + "\n\n";
  out += line(table.header) + "|";
  for (std::size_t k = 0; k < table.header.size(); ++k) out += k ? "--:|" : "---|";
  out += "\n";
  for (const auto& row : table.rows) out += line(row);
  return out + "\n";
}

std::string asCsv(const Table& table) {
  const auto line = [](const std::vector<std::string>& cells) {
    std::string out;
    for (const std::string& text : cells) {
      if (!out.empty() || &text != &cells.front()) out += ',';
      if (text.find_first_of(",\"\n") == std::string::npos) {
        out += text;
        continue;
      }
      out += '"';
      for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
      out += '"';
    }
    return out + "\r\n";
  };
  std::string out = line(table.header);
  for (const auto& row : table.rows) out += line(row);
  return out;
}

double median(std::vector<double> values) {
  if (values.empty()) return kNothing;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

std::string cell(const char* format, double value) {
  if (!std::isfinite(value)) return {};
  char out[64];
  std::snprintf(out, sizeof out, format, value);
  return out;
}

}  // namespace ridgecast::evaluation
