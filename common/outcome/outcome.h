#pragma once
// A failure for reasons outside the program (a person, a file, a socket) is returned as an Outcome: a value, or an Error whose message says
// in one sentence what is wrong and what would be right. Broken contracts inside the program end it: contract.h.

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
