#include "client/c/boundary.h"
#include "common/version/version.h"

namespace ridgecast::c {

namespace {
thread_local std::string message;
}  // namespace

rc_status fail(rc_status status, std::string sentence) {
  message = std::move(sentence);
  return status;
}

rc_status fail(const world::Failure& failure) {
  switch (failure.fault) {
    case world::Fault::kInvalid:
      return fail(RC_INVALID, failure.message);
    case world::Fault::kRefused:
      return fail(RC_REFUSED, failure.message);
    case world::Fault::kLost:
      return fail(RC_LOST, failure.message);
    case world::Fault::kTimeout:
      return fail(RC_TIMEOUT, failure.message);
  }
  return fail(RC_INTERNAL, failure.message);
}

rc_status noSize(const char* name) { return fail(RC_INVALID, std::string("size must be sizeof(") + name + ")"); }

Outcome<std::chrono::milliseconds> milliseconds(double seconds) {
  if (!(seconds >= 0 && seconds <= 1e6)) return Error{"a timeout is 0 to 1000000 seconds"};
  return std::chrono::milliseconds(static_cast<std::int64_t>(std::ceil(seconds * 1e3)));
}

}  // namespace ridgecast::c

extern "C" {

const char* rc_message(void) { return ridgecast::c::message.c_str(); }

const char* rc_version(void) {
  static const std::string version(ridgecast::version::product());
  return version.c_str();
}
}
