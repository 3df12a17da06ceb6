#pragma once
// The keys of window and page, one table for both: keys.json. The page reads the same file.

#include <string>
#include <vector>

namespace ridgecast::keys {

struct Row {
  std::string action;  // the name in the code
  std::string keys;    // as a person reads them: "X", "P / F12", "W A S D", "Ctrl+Q"; letters are places on a US keyboard
  std::string words;   // what it does
  std::string where;   // "both", "window" or "page"
};

// In the order of the help. One copy, made at first use; any thread.
const std::vector<Row>& table();

// The strokes of a row that do the same: "P / F12" -> "P", "F12".
std::vector<std::string> strokesOf(const Row& row);

}  // namespace ridgecast::keys
