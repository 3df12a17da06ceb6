#pragma once
// What a client's pictures are worth: a real server and a real client without a window, the mesh at rest drawn against the ray march.

#include <memory>
#include <string>
#include <vector>

#include "common/camera/camera.h"
#include "tests/support/server_process.h"

namespace ridgecast::bench {

class Pictures {
 public:
  // Starts the server beside this program. Where there is no client, or it cannot draw, settled() answers NaN and says why once.
  Pictures(const std::string& programFolder, const std::string& terrain, const camera::Camera& camera,
           const std::vector<std::string>& moreOfServer = {});

  struct Similarity {
    double all, terrain;  // mean SSIM of the picture, and of the terrain's pixels
  };
  Similarity settled(const std::string& metric, double threshold);

 private:
  std::string client_;
  testing_support::ScratchFolder folder_;
  std::unique_ptr<testing_support::ServerProcess> server_;
};

}  // namespace ridgecast::bench
