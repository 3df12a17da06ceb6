#pragma once
// What a terrain file declares in comments that begin with //! :
//   //! rolling hills with lakes                                            the first such line of its own: a summary
//   //! materials: mud, moor                                               names of materials 9, 10, ... (terrain/materials.h)
//   const float snowLine = 1800.0;  //! 0..4000 m: height of the snow line  a parameter: default, least..most, unit (optional)
// Setting a parameter rewrites its literal. The resulting text is the terrain: it is compiled, hashed and sent to clients.

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::glsl {

struct Parameter {
  std::string name;
  double value = 0, least = 0, most = 0;
  std::string unit, summary;
  std::size_t begin = 0, end = 0;  // of the literal in the text
};

struct Declaration {
  std::string summary;
  std::vector<std::string> materials;  // own ones, from number 9 on
  std::vector<Parameter> parameters;   // in the file's order
};

// A value for a parameter, as --param gives it.
using Assignment = std::pair<std::string, double>;

// "name=value" -> Assignment. Error: another form, or a value that is not a finite number.
Outcome<Assignment> parseAssignment(std::string_view text);

// Errors begin with "`file`:line: ".
Outcome<Declaration> readDeclaration(std::string_view file, std::string_view text);

// The text with these values as defaults. Error: an undeclared name (the message lists the declared ones), or a value out of range.
Outcome<std::string> withParameters(std::string_view file, std::string_view text, const Declaration& declaration,
                                    const std::vector<Assignment>& assignments);

// The values that a text gives its parameters: the literals as floats, in the file's order.
std::vector<float> valuesOf(std::string_view text, const Declaration& declaration);

// "snowLine = 1800 m (0..4000): height of the snow line"
std::string describe(const Parameter& parameter);

}  // namespace ridgecast::glsl
