#pragma once
// Answers queries about a terrain, and measures how far a mesh is from it. Pure functions; any thread.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::query {

// Answers a query in pieces of at most some hundred microseconds (of rays at a new place a millisecond), between which others run. A
// decoded query is in range, or its refusal is the answer. One thread at a time.
class Answering {
 public:
  // `edit`: the terrain's, reported in the answer.
  Answering(std::shared_ptr<const terrain::Terrain> terrain, wire::Query query, std::uint64_t edit = 0);
  bool isDone() const { return done_ == size_; }
  const wire::Query& query() const { return query_; }
  const terrain::Terrain& terrain() const { return *terrain_; }
  std::uint64_t work();  // the next piece, some places or rays; returns the heights of the terrain that it took
  wire::Answer take() { return std::move(answer_); }

 private:
  const std::shared_ptr<const terrain::Terrain> terrain_;
  const wire::Query query_;
  std::size_t size_ = 0, done_ = 0;  // places or rays
  wire::Answer answer_;
};

// The largest vertical distance in metres between the true terrain and the leaf's triangles. Sampled on a grid of 1/64 of the leaf's
// side (at least 1/8 m) over each triangle and at its centre and corners. Adds half the difference of neighbouring samples for what
// lies between them. 0 for an empty leaf.
float deviation(const terrain::Terrain& terrain, const mesh::LeafMesh& leaf);

}  // namespace ridgecast::query
