#include "common/text/file.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <limits>

#include "common/outcome/contract.h"

namespace ridgecast::text {

std::optional<std::string> readFile(const std::filesystem::path& file, std::size_t most) {
  expects(most < std::numeric_limits<std::size_t>::max(), "one byte more than the most can be counted");
  std::ifstream in(file, std::ios::binary);
  std::string bytes;
  for (std::array<char, 16 << 10> part; in && bytes.size() <= most; bytes.append(part.data(), static_cast<std::size_t>(in.gcount())))
    in.read(part.data(), static_cast<std::streamsize>(std::min(part.size(), most + 1 - bytes.size())));
  if (!in.is_open() || in.bad()) return std::nullopt;
  return bytes;
}

}  // namespace ridgecast::text
