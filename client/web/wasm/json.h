#pragma once
// JSON for the page, written from left to right.

#include <cmath>
#include <concepts>
#include <cstdio>
#include <string>
#include <string_view>

#include "common/text/text.h"

namespace ridgecast::page {

inline std::string json(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (static_cast<unsigned char>(c) >= 0x20) {
      out += c;
      continue;
    }
    char escaped[8];
    std::snprintf(escaped, sizeof escaped, "\\u%04x", static_cast<unsigned>(c));
    out += escaped;
  }
  return out += '"';
}
inline std::string json(const char* text) { return json(std::string_view(text)); }
inline std::string json(std::integral auto value) {
  if constexpr (std::same_as<decltype(value), bool>)
    return value ? "true" : "false";
  else
    return std::to_string(value);
}
inline std::string json(double value) { return std::isfinite(value) ? text::rounded(value, 17) : "null"; }

// {"name":value,...}
class Object {
 public:
  template <class Value>
  Object& operator()(std::string_view name, const Value& value) {
    out_ += (out_.size() > 1 ? "," : "") + json(name) + ":" + json(value);
    return *this;
  }
  friend std::string json(const Object& object) { return object.out_ + "}"; }

 private:
  std::string out_ = "{";
};

// [a,b,...]
class List {
 public:
  template <class Value>
  List& operator()(const Value& value) {
    out_ += (out_.size() > 1 ? "," : "") + json(value);
    return *this;
  }
  friend std::string json(const List& list) { return list.out_ + "]"; }

 private:
  std::string out_ = "[";
};

}  // namespace ridgecast::page
