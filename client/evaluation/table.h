#pragma once
// A table of figures, for pages, documents and other programs.

#include <limits>
#include <string>
#include <vector>

namespace ridgecast::evaluation {

struct Table {
  std::string name;         // of its file
  std::string title, note;  // for people; the note may be empty
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;  // as many cells as the header has
};

std::string escapedHtml(const std::string& text);
std::string asHtml(const Table& table);      // with its title as a heading
std::string asMarkdown(const Table& table);  // likewise
std::string asCsv(const Table& table);       // RFC 4180, title and note left out

inline constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();  // what was not measured
double median(std::vector<double> values);                                    // the greater of two in the middle; of none: kNothing
// printf with one number; nothing that is finite: an empty cell.
std::string cell(const char* format, double value);

}  // namespace ridgecast::evaluation
