#include "server/encoding/held_points.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "common/outcome/contract.h"
#include "common/points/guess.h"

namespace ridgecast::encoding {

using lattice::LeafAddress;
using triangulation::kInfinite;
using triangulation::kOutside;
using triangulation::VertexId;

namespace {

lattice::Vertex absolute(const triangulation::Vertex& v, lattice::Point anchor) { return {anchor.x + v.x, anchor.z + v.z, v.y}; }

// Vertices whose height the client does not know yet. One for each thread, empty between uses.
std::vector<bool>& unknownVertices(std::size_t capacity) {
  thread_local std::vector<bool> unknown;
  if (unknown.size() < capacity) unknown.resize(capacity);
  return unknown;
}

}  // namespace

std::vector<std::uint8_t> HeldPoints::update(const replica::Changes& changes, pipeline::IteratingMesh& mesh, News& news) {
  expects(mesh.surface().mesh != nullptr, "points are those of a triangulation");
  if (changes.anew) {
    beginAnew(changes, mesh);
    for (const mesh::LeafState& leaf : mesh.leaves()) compareLeaf(leaf.address, mesh);
  } else {
    replaceLeaves(changes);
    std::vector<LeafAddress> all;
    std::ranges::merge(changes.touched, changes.come, std::back_inserter(all));
    for (const LeafAddress& leaf : all)
      if (std::ranges::binary_search(changes.come, leaf))
        compareLeaf(leaf, mesh);
      else
        followLeaf(leaf, mesh);
  }
  const Surface surface = mesh.surface();
  if (changes.anew || surface.outside != outside_) compareOpen(surface);
  outside_ = surface.outside;
  std::vector<std::uint8_t> payload = write(changes, mesh, news);
  sizes_.clear();
  changed_.clear();
  changed_.shrink_to_fit();  // the first payload's are many
  return payload;
}

// What the client has of the leaves alone: all corners of their triangles.
void HeldPoints::beginAnew(const replica::Changes& changes, const pipeline::IteratingMesh& mesh) {
  leaves_.clear();
  open_.clear();
  active_.clear();
  for (const mesh::LeafState& leaf : mesh.leaves()) leaves_[leaf.address];
  if (!changes.come.empty()) return;  // it held none
  const Surface surface = mesh.surface();
  Filed last;
  const auto take = [&](triangulation::RegionId region) {
    surface.mesh->vertexPages().forEach(region, [&](VertexId v) {
      bool isCorner = false;
      if (v != kInfinite)
        surface.mesh->forEachAround(v, [&](triangulation::HalfEdge h) { isCorner |= surface.mesh->regionOf(h >> 2) != kOutside; });
      if (isCorner) file(absolute(surface.mesh->vertex(v), surface.anchor), last);
    });
  };
  for (const mesh::LeafState& leaf : mesh.leaves()) take(mesh.region(leaf.address));
  take(kOutside);
  for (auto& [leaf, points] : leaves_) std::ranges::sort(points, {}, &Point::place);
  for (auto& [square, points] : open_) std::ranges::sort(points, {}, &Point::place);
}

// What lay in squares that are gone lies in others now.
void HeldPoints::replaceLeaves(const replica::Changes& changes) {
  std::vector<std::pair<LeafAddress, Points>> homeless;
  for (const LeafAddress& leaf : changes.gone)
    if (auto node = leaves_.extract(leaf)) homeless.emplace_back(leaf, std::move(node.mapped()));
  if (leaves_.empty()) {  // somewhere else altogether
    homeless.clear();
    open_.clear();
  }
  for (const LeafAddress& leaf : changes.come) leaves_[leaf];
  std::erase_if(open_, [&](auto& square) {
    const auto isHeir = [&](const LeafAddress& leaf) { return square.first.isAncestorOf(leaf) || leaf.isAncestorOf(square.first); };
    if (std::ranges::none_of(changes.come, isHeir)) return false;
    homeless.emplace_back(square.first, std::move(square.second));
    return true;
  });
  std::set<Points*> filled;
  Points* before = nullptr;
  Filed last;
  for (const auto& [square, points] : homeless)
    for (const Point& p : points)
      if (Points* const at = &file({square.x() + p.x, square.z() + p.z, p.y}, last); at != before) filled.insert(before = at);
  for (Points* points : filled) std::ranges::sort(*points, {}, &Point::place);
}

// `last`: of the point before, which often lies in the same leaf.
HeldPoints::Points& HeldPoints::file(const lattice::Vertex& v, Filed& last) {
  if (!last.points || lattice::leafAt({v.x, v.z}, last.leaf.level) != last.leaf) {
    last.points = nullptr;
    for (int level = 0; level <= lattice::kMaxLevel && !last.points; ++level) {
      last.leaf = lattice::leafAt({v.x, v.z}, level);
      if (const auto leaf = leaves_.find(last.leaf); leaf != leaves_.end()) last.points = &leaf->second;
    }
  }
  const LeafAddress square = last.points ? last.leaf : lattice::leafAt({v.x, v.z}, points::kOpenLevel);
  Points& points = last.points ? *last.points : open_[square];
  points.push_back(inside(square, v));
  return points;
}

void HeldPoints::list(LeafAddress leaf, std::span<const VertexId> vertices, const Surface& surface) {
  list_.clear();
  for (VertexId v : vertices) list_.push_back(listed(inside(leaf, absolute(surface.mesh->vertex(v), surface.anchor)), v));
  std::ranges::sort(list_, {}, &Listed::place);
}

void HeldPoints::compareLeaf(LeafAddress leaf, pipeline::IteratingMesh& mesh) {
  const Surface surface = mesh.surface();
  vertices_.clear();
  mesh.takeFresh(leaf, vertices_);
  vertices_.clear();
  surface.mesh->vertexPages().forEach(mesh.region(leaf), [&](VertexId v) { vertices_.push_back(v); });
  list(leaf, vertices_, surface);
  compare(leaf, leaves_.at(leaf), list_);
}

// A leaf that the client held at the last payload: what it does not hold yet is fresh. Where anything went, all is compared.
void HeldPoints::followLeaf(LeafAddress leaf, pipeline::IteratingMesh& mesh) {
  const Surface surface = mesh.surface();
  vertices_.clear();
  mesh.takeFresh(leaf, vertices_);
  list(leaf, vertices_, surface);
  Points& held = leaves_.at(leaf);
  const auto isHeld = [&](const Listed& listed) { return std::ranges::binary_search(held, listed.place, {}, &Point::place); };
  const auto known = static_cast<std::size_t>(std::ranges::count_if(list_, isHeld));
  if (held.size() + list_.size() - known == surface.mesh->vertexCount(mesh.region(leaf)))
    add(leaf, held);
  else
    compareLeaf(leaf, mesh);
}

void HeldPoints::compareOpen(const Surface& surface) {
  std::map<LeafAddress, List> lists;
  for (const auto& [square, points] : open_) lists[square];
  surface.mesh->vertexPages().forEach(kOutside, [&](VertexId v) {
    if (v == kInfinite) return;
    const lattice::Vertex at = absolute(surface.mesh->vertex(v), surface.anchor);
    const LeafAddress square = lattice::leafAt({at.x, at.z}, points::kOpenLevel);
    lists[square].push_back(listed(inside(square, at), v));
  });
  for (auto& [square, list] : lists) {
    Points& held = open_[square];
    std::ranges::sort(list, {}, &Listed::place);
    compare(square, held, list);
    if (held.empty()) open_.erase(square);
  }
}

// What is listed comes to what is held, or raises it; that is noted.
void HeldPoints::add(LeafAddress leaf, Points& held) {
  Changed c;
  c.change.square = leaf;
  const std::size_t size = held.size();
  for (const Listed& listed : list_) {
    const auto end = held.begin() + static_cast<std::ptrdiff_t>(size),
               at = std::ranges::lower_bound(held.begin(), end, listed.place, {}, &Point::place);
    if (at == end || at->place() != listed.place) {
      c.change.inserted.push_back({listed.x(), listed.z()});
      c.inserted.push_back(listed.vertex);
      held.push_back({listed.x(), listed.z(), listed.y});
    } else if (at->y != listed.y) {
      c.change.raised.push_back(static_cast<std::uint32_t>(at - held.begin()));
      c.before.push_back(std::exchange(at->y, listed.y));
      c.raised.push_back(listed.vertex);
    }
  }
  if (c.change.empty()) return;
  std::ranges::inplace_merge(held, held.begin() + static_cast<std::ptrdiff_t>(size), {}, &Point::place);
  sizes_.push_back(static_cast<std::uint32_t>(size));
  changed_.push_back(std::move(c));
}

// `held` becomes `now`, ascending by place; what that changes is noted.
void HeldPoints::compare(LeafAddress square, Points& held, const List& now) {
  Changed c;
  c.change.square = square;
  auto before = held.cbegin();
  std::uint32_t place = 0, stays = 0;
  const auto remove = [&] {
    c.change.removed.push_back(place++);
    ++before;
  };
  for (const Listed& listed : now) {
    while (before != held.cend() && before->place() < listed.place) remove();
    if (before == held.cend() || listed.place < before->place()) {
      c.change.inserted.push_back({listed.x(), listed.z()});
      c.inserted.push_back(listed.vertex);
      continue;
    }
    if (before->y != listed.y) {
      c.change.raised.push_back(stays);
      c.before.push_back(before->y);
      c.raised.push_back(listed.vertex);
    }
    ++stays;
    ++place;
    ++before;
  }
  while (before != held.cend()) remove();
  if (c.change.empty()) return;
  sizes_.push_back(static_cast<std::uint32_t>(held.size()));
  held.clear();
  held.reserve(now.size());
  for (const Listed& listed : now) held.push_back({listed.x(), listed.z(), listed.y});
  changed_.push_back(std::move(c));
}

std::vector<std::uint8_t> HeldPoints::write(const replica::Changes& changes, const pipeline::IteratingMesh& mesh, News& news) {
  const Surface surface = mesh.surface();
  const triangulation::Triangulation& t = *surface.mesh;
  std::vector<std::uint8_t> payload;
  points::Writer writer(payload);
  if (changes.anew || !changes.gone.empty() || !changes.come.empty()) {
    squares_.clear();
    for (const mesh::LeafState& leaf : mesh.leaves()) squares_.push_back(leaf.address);
  }
  std::vector<points::Change> list;
  for (Changed& c : changed_) list.push_back(std::move(c.change));
  auto size = sizes_.cbegin();
  expects(writer.changes(
              {squares_, changes.come, active_}, [&](const LeafAddress&) { return *size++; }, list) &&
              size == sizes_.cend(),
          "squares that change come in canonical order, and none twice");
  const auto tell = [&](VertexId v, int level) {
    news.points.push_back(absolute(t.vertex(v), surface.anchor));
    news.levels.push_back(level);
  };
  std::vector<bool>& unknown = unknownVertices(t.vertexCapacity());
  for (std::size_t k = 0; k < list.size(); ++k) {
    const int level = list[k].square.level;
    for (VertexId v : changed_[k].inserted) unknown[v] = true;
    for (std::size_t n = 0; n < changed_[k].raised.size(); ++n) {
      const VertexId v = changed_[k].raised[n];
      writer.raised(level, changed_[k].before[n], t.vertex(v).y);
      tell(v, level);
    }
  }
  points::Guesser guesser;
  for (std::size_t k = 0; k < list.size(); ++k)
    for (VertexId v : changed_[k].inserted) {
      const points::Guess guess = guesser.guess(t, v, [&](VertexId u) { return !unknown[u]; });
      writer.inserted(list[k].square.level, guess.y, guess.isSure, t.vertex(v).y);
      unknown[v] = false;
      tell(v, list[k].square.level);
    }
  writer.finish();
  active_.clear();
  for (const points::Change& change : list) active_.push_back(change.square);
  std::ranges::sort(active_);
  return payload;
}

}  // namespace ridgecast::encoding
