#pragma once
// What can fail for reasons outside the program (a person, a file, a socket) returns an Outcome: a value, or an Error whose message
// says what was wrong and what would be right, in one sentence for a person. Broken contracts inside the program are assertions.

#include <string>
#include <utility>

#include <boost/assert/source_location.hpp>
#include <boost/system/result.hpp>

#include <stdexcept>

namespace ridgecast {

struct Error {
  std::string message;
};

[[noreturn]] inline void throw_exception_from_error(const Error& e, const boost::source_location&) { throw std::runtime_error(e.message); }

template <class T>
using Outcome = boost::system::result<T, Error>;

}  // namespace ridgecast
