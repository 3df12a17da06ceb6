// A terrain file's text, as far as it goes before GLSL's front end has accepted it: checks, //! lines, parameters, tokens.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "common/glsl/check.h"
#include "common/glsl/declaration.h"
#include "common/glsl/tokens.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ridgecast::glsl;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (!checkText("a.glsl", text)) return 0;
  if (const auto declared = readDeclaration("a.glsl", text)) {
    for (const Parameter& p : declared->parameters) {
      if (&*std::ranges::find(declared->parameters, p.name, &Parameter::name) != &p) continue;  // twice: GLSL's front end refuses it
      const auto changed = withParameters("a.glsl", text, *declared, {{p.name, p.least}});
      if (!changed || !readDeclaration("a.glsl", *changed)) std::abort();  // what is in range is taken, and stays a declaration
      if (describe(p).empty()) std::abort();
    }
  }
  if (const auto tokens = tokenise("a.glsl", text))
    if (const auto items = topLevel("a.glsl", *tokens))
      for (const TopLevel& item : *items)
        if (item.what == TopLevel::What::kFunction) signatureOf(*tokens, item);
  return 0;
}
