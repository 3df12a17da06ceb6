#pragma once
// A terrain file's tokens as the translator reads them: the questions that it asks of functions, structs, statements and expressions.
// Positions are indices of tokens. The GLSL front end has accepted the text: brackets match, names are declared.

#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/glsl/tokens.h"

namespace ridgecast::glsl {

struct CountedLoop {
  std::string name;
  long first = 0;
  std::size_t trips = 0;
};

// What the prelude's functions return, by their names. A file's overloads of these stand beside the prelude's.
const std::map<std::string, std::string>& preludeFunctions();

// Keeps references to tokens and items. One thread.
class Syntax {
 protected:
  struct Scope {
    std::map<std::string, std::string> names, types;  // of variables: in C++; without sizes
    bool isSwitch = false;
  };

  // Reads structs, functions, and everything that terrainHeight reaches, with `colours` also terrainColor.
  Syntax(const std::vector<Token>& tokens, const std::vector<TopLevel>& items, bool colours);

  bool is(std::size_t i, std::string_view text) const { return i < tokens_.size() && tokens_[i].text == text; }
  bool isName(std::size_t i) const { return i < tokens_.size() && tokens_[i].kind == Kind::kName; }
  bool isType(std::size_t i) const;
  bool isDeclaration(std::size_t i) const { return isType(i) && isName(i + 1); }
  bool isLocal(const std::string& name) const;  // a variable of a scope that is open
  bool isOfPictures(std::size_t i) const;       // a call such as texture() or dFdx()
  bool isStatement(std::size_t i) const;        // whether one begins here

  // Ends of the elements between two brackets.
  std::vector<std::size_t> elements(std::size_t open, std::size_t close) const;
  // Of the bracket that closes here.
  std::size_t opening(std::size_t close) const;
  // Index after the statement that begins at i.
  std::size_t statementEnd(std::size_t i) const;
  // Words of the functions of this name with all calls inlined, as the compiler does it.
  double inlined(const std::string& name);
  // `for (int i = 0; i < 5; ++i)` with constant numbers, few trips, and a body that neither changes i nor leaves early.
  std::optional<CountedLoop> counted(std::size_t open, std::size_t close, std::size_t bodyEnd) const;
  // Of `.xz` at a dot, and of `.xyz.xz` as one, as indices; empty: it selects no components.
  std::vector<int> selected(std::size_t dot) const;
  // Whether the components that are selected up to `after` are assigned to, they or one of them: p.xz *= m, (p.xz)[0] = 1.0.
  bool areAssigned(std::size_t dot, std::size_t after) const;

  const std::vector<Token>& tokens_;
  const std::vector<TopLevel>& items_;
  std::set<std::string> wanted_, functions_;
  std::multimap<std::string, std::vector<bool>> written_{{"modf", {false, true}}};  // of each overload: which arguments it writes
  std::vector<Scope> scopes_;                                                       // open ones, the file's first

 private:
  void writes(const TopLevel& f);
  std::optional<long> number(std::size_t i) const;  // an integer literal, or the name of one of the file's integer constants
  std::string typeBefore(std::size_t end) const;    // the struct that the expression before a dot, or an index, is one of, or an array of
  std::string resultOf(const std::string& name) const;  // of a function, or of a struct's constructor

  std::set<std::string> structs_{"Place", "Corners"};
  std::map<std::string, std::map<std::string, std::string>> members_{{"Place", {}}, {"Corners", {}}};  // of structs, and their types
  std::map<std::string, double> sizes_;
};

}  // namespace ridgecast::glsl
