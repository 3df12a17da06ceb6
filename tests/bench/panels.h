#pragma once
// Curves over the same values of x, side by side in one SVG that needs nothing else to be shown.

#include <string>
#include <vector>

namespace ridgecast::bench {

struct Curve {
  std::string name;
  std::vector<double> y;  // one for each x; what is not finite, or not above 0 on a logarithmic axis, is left out
};
struct Panel {
  std::string title;  // with its unit
  std::vector<Curve> curves;
  bool logarithmic = false;
  double wanted = 0;  // a dashed line; 0: none
  std::string wantedText;
};

// x > 0, ascending, doubling: drawn at equal distances.
std::string drawPanels(const std::string& title, const std::string& xTitle, const std::vector<double>& x, const std::vector<Panel>& panels);

}  // namespace ridgecast::bench
