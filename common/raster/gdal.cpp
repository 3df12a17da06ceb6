#include "common/raster/gdal.h"

#include <algorithm>
#include <chrono>

#include "common/outcome/contract.h"
#include "common/process/child.h"
#include "common/text/file.h"

namespace ridgecast::raster {
namespace {

constexpr int kMaxMegabytes = 256;  // of GDAL's cache

// Drivers that ask a server for what a small file names.
constexpr const char* kSkipped =
    "WCS,WMS,WMTS,HTTP,DAAS,EEDA,EEDAI,NGW,OGCAPI,PLMOSAIC,PLSCENES,STACIT,STACTA,PostGISRaster,Rasterlite,MBTiles,KEA,Zarr,PDF";

}  // namespace

Outcome<Gdal> Gdal::find(const std::string& what, std::stop_token stop) {
  Gdal out;
  out.stop_ = std::move(stop);
  for (const char* program : {"gdalinfo", "gdal_translate", "gdalsrsinfo", "gdalbuildvrt"}) {
    auto found = process::findProgram(program);
    if (!found) return Error{what + ": install the package gdal-bin"};
    out.folder_ = found->parent_path();
  }
  auto scratch = process::Scratch::create();
  if (!scratch) return scratch.error();
  out.scratch_.emplace(std::move(*scratch));
  return out;
}

Outcome<std::string> Gdal::run(const char* program, std::vector<std::string> arguments, std::uint64_t mostBytes) const {
  expects(scratch_.has_value(), "GDAL writes before its folder is taken");
  const std::filesystem::path log = file("log");
  for (const auto& [key, value] : {std::pair<std::string, std::string>{"CPL_LOG", log.string()},
                                   {"GDAL_SKIP", kSkipped},
                                   {"GDAL_CACHEMAX", std::to_string(kMaxMegabytes)},
                                   {"GDAL_MAX_DATASET_POOL_SIZE", "64"},
                                   {"CPL_VSIL_CURL_ALLOWED_FILENAME", "none"},
                                   {"GDAL_HTTP_PROXY", "127.0.0.1:9"},
                                   {"GDAL_HTTP_TIMEOUT", "1"},
                                   {"GDAL_DISABLE_READDIR_ON_OPEN", "FALSE"}})
    arguments.insert(arguments.end(), {"--config", key, value});
  process::ChildLimits limits;
  limits.time = std::chrono::seconds(600);
  limits.fileSize = mostBytes + (std::uint64_t{16} << 20);
  if (process::ReachRules::areKept()) {
    limits.reach = process::Reach{reads_, {scratch_->path()}};
    std::error_code failed;
    if (const auto own = std::filesystem::weakly_canonical(folder_, failed).parent_path(); own != own.root_path())
      limits.reach->reads.push_back(own);
    for (const char* const system : {"/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/dev/null", "/dev/urandom"})
      limits.reach->reads.emplace_back(system);
  }
  const auto ended = process::runChild(folder_ / program, arguments, limits, stop_);
  if (!ended) return ended.error();
  const auto complained = text::readFile(log, 4096);
  std::error_code ignored;
  std::filesystem::remove(log, ignored);
  if (ended->status == 0) return {boost::system::in_place_value, ended->output};
  if (ended->timedOut) return Error{std::string(program) + " took longer than 10 minutes"};
  std::string first = complained && !complained->empty() ? *complained : ended->output;
  if (const std::size_t at = first.find("ERROR "); at != std::string::npos) first = first.substr(first.find(": ", at) + 2);
  first = first.substr(0, std::min<std::size_t>(first.find('\n'), 300));
  return Error{first.empty() ? std::string(program) + " ended with status " + std::to_string(ended->status) : first};
}

}  // namespace ridgecast::raster
