#include "common/version/version.h"

#include "ridgecast_commit.h"

namespace ridgecast::version {

std::string_view product() { return RIDGECAST_VERSION; }
std::string_view commit() { return RIDGECAST_COMMIT; }

std::string describe(std::string_view program, unsigned protocol) {
  return std::string(program) + " " + RIDGECAST_VERSION ", protocol " + std::to_string(protocol) + ", commit " RIDGECAST_COMMIT;
}

}  // namespace ridgecast::version
