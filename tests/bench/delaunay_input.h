#pragma once
// What both programs of `ridgecast-bench delaunay` do, as a file: insertions in the order in which the engine makes them (grids first,
// then round after round, leaf by leaf, points inside triangles), each with an earlier point that is a corner of the triangle it falls
// into, and then removals, leaf by leaf, of every other point.

#include <cstdint>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

namespace ridgecast::bench {

struct Insertion {
  std::int32_t x, z;     // |.| < 2^26
  std::uint32_t corner;  // an earlier insertion that is a corner of the triangle that holds this point; its own index: none
};

struct DelaunayInput {
  std::vector<Insertion> insertions;
  std::vector<std::uint32_t> at;        // our id of the triangle that each point falls into: the engine knows it. Not in the file
  std::vector<std::uint32_t> removals;  // indices of insertions

  std::uint64_t hash() const {
    std::uint64_t h = 14695981039346656037ull;
    const auto add = [&](std::uint32_t v) { h = (h ^ v) * 1099511628211ull; };
    for (const Insertion& p : insertions) add(static_cast<std::uint32_t>(p.x)), add(static_cast<std::uint32_t>(p.z)), add(p.corner);
    for (std::uint32_t r : removals) add(r);
    return h;
  }
};

inline void writeInput(const DelaunayInput& input, const std::string& path) {
  FILE* f = std::fopen(path.c_str(), "wb");
  if (!f) throw std::runtime_error("cannot write " + path);
  const std::uint64_t sizes[2] = {input.insertions.size(), input.removals.size()};
  std::fwrite(sizes, sizeof sizes, 1, f);
  std::fwrite(input.insertions.data(), sizeof(Insertion), input.insertions.size(), f);
  std::fwrite(input.removals.data(), sizeof(std::uint32_t), input.removals.size(), f);
  if (std::fclose(f) != 0) throw std::runtime_error("cannot write " + path);
}

inline DelaunayInput readInput(const std::string& path) {
  FILE* f = std::fopen(path.c_str(), "rb");
  if (!f) throw std::runtime_error("cannot read " + path);
  std::uint64_t sizes[2] = {0, 0};
  DelaunayInput input;
  bool whole = std::fread(sizes, sizeof sizes, 1, f) == 1 && sizes[0] < 100'000'000 && sizes[1] <= sizes[0];
  if (whole) {
    input.insertions.resize(sizes[0]);
    input.removals.resize(sizes[1]);
    whole = std::fread(input.insertions.data(), sizeof(Insertion), sizes[0], f) == sizes[0] &&
            std::fread(input.removals.data(), sizeof(std::uint32_t), sizes[1], f) == sizes[1];
  }
  std::fclose(f);
  if (!whole) throw std::runtime_error(path + " is not an input of this bench");
  return input;
}

}  // namespace ridgecast::bench
