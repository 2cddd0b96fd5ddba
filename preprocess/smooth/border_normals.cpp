#include "preprocess/smooth/border_normals.h"

#include <algorithm>
#include <deque>
#include <future>
#include <utility>

namespace quarry {
namespace {

/// Whether a box lies in a cell, away from its borders.
bool LiesInside(const Box& cell, const Box& box) {
  return box.lower.x > cell.lower.x && box.lower.y > cell.lower.y && box.lower.z > cell.lower.z &&
         box.upper.x < cell.upper.x && box.upper.y < cell.upper.y && box.upper.z < cell.upper.z;
}

/// The first region whose cell contains a position: it alone sends the position's normals to the others.
uint32_t OwnerOf(const RegionTree& tree, const glm::vec3& position) {
  uint32_t owner = ~uint32_t{0};
  ForEachLeaf(tree.nodes, {position, position}, [&](KdNode leaf) {
    if (leaf.count() != 0 && Contains(tree.regions[leaf.first()].cell, position))
      owner = std::min(owner, leaf.first());
  });
  return owner;
}

}  // namespace

Result<BorderNormals> BorderNormals::Open(const RegionTree& tree, const std::string& prefix, float padding,
                                          double crease, const SpillFiles::Options& options) {
  QUARRY_ASSIGN(SpillFiles files,
                SpillFiles::Open(prefix, tree.regions.size(), sizeof(BorderNormal), options));
  return BorderNormals(tree, padding, crease, std::move(files));
}

/// A bit for each corner whose normal this region must send to others.
uint32_t BorderNormals::WantedCorners(uint32_t region, const TriangleRecord& t,
                                      const HashShare& share) const {
  const Box& cell = tree_->regions[region].cell;
  if (!IsSmoothed(t) || LiesInside(cell, t.PaddedBox(padding_))) return 0;
  uint32_t lacked = 0;  // by a region that has the triangle
  ForEachRegion(*tree_, t, padding_, [&](uint32_t other, const Box&) {
    for (uint32_t k = 0; k < 3; ++k)
      lacked |= Contains(tree_->regions[other].cell, t.vertices[k]) ? 0 : 1u << k;
  });
  uint32_t wanted = 0;
  for (uint32_t k = 0; k < 3; ++k) {
    const glm::vec3& p = t.vertices[k];
    if ((lacked >> k & 1) != 0 && Contains(cell, p) && share.Has(HashOfPosition(p)) &&
        OwnerOf(*tree_, p) == region)
      wanted |= 1u << k;
  }
  return wanted;
}

BorderNormals::Border BorderNormals::Find(uint32_t region, const SpillFile& triangles,
                                          const HashShare& share) const {
  CornerFans fans(crease_);
  Border border;
  std::vector<Straddler>& straddlers = border.straddlers;
  uint32_t number = 0;
  border.status = ForEachRecord(triangles, 0, triangles.count(), [&](const TriangleRecord& t) -> Status {
    if (border.too_many) return {};
    const uint32_t wanted = WantedCorners(region, t, share);
    for (uint32_t k = 0; k < 3 && wanted != 0; ++k) {
      if ((wanted >> k & 1) == 0) continue;
      // A fan of more corners stays flat.
      if (fans.Open(t.vertices[k], HashOfPosition(t.vertices[k])) > CornerFans::kMostAround) continue;
      border.too_many |= straddlers.size() >= kMostStraddlers;
      if (border.too_many) continue;
      straddlers.push_back({{{t.vertices[0], t.vertices[1], t.vertices[2]}}, t.id, {number, k, 0}});
    }
    ++number;
    return {};
  });
  if (!border.status || border.too_many || fans.empty()) return border;
  number = 0;
  border.status = ForEachRecord(triangles, 0, triangles.count(), [&](const TriangleRecord& t) -> Status {
    border.too_many |= fans.corners() > kMostCorners;
    for (uint32_t k = 0; k < 3 && IsSmoothed(t) && !border.too_many; ++k) {
      const uint32_t hash = HashOfPosition(t.vertices[k]);
      if (fans.Has(t.vertices[k], hash)) fans.Add(t, number, k, hash);
    }
    ++number;
    return {};
  });
  if (!border.status || border.too_many) return border;
  const auto place = [](const CornerNormal& c) { return std::pair(c.triangle, c.corner); };
  for (const CornerNormal& normal : fans.Solve()) {
    const auto at = std::ranges::lower_bound(straddlers, place(normal), {},
                                             [&](const Straddler& s) { return place(s.found); });
    if (at != straddlers.end() && place(at->found) == place(normal)) at->found.normal = normal.normal;
  }
  std::erase_if(straddlers, [](const Straddler& s) { return s.found.normal == 0; });
  return border;
}

/// Sends the normals of a pass. A pass with too many straddlers is repeated in parts.
Status BorderNormals::SendAll(uint32_t region, const SpillFile& triangles, const HashShare& share,
                              const Border& border) {
  QUARRY_TRY(border.status);
  if (!border.too_many) return Send(border.straddlers);
  constexpr uint32_t kMostPasses = 1u << 27;  // positions forged to have one hash stay flat
  if (share.passes > kMostPasses) return {};
  for (uint32_t part = 0; part < HashShare::kParts; ++part) {
    const HashShare smaller = share.Part(part);
    QUARRY_TRY(SendAll(region, triangles, smaller, Find(region, triangles, smaller)));
  }
  return {};
}

/// Sends normals to the regions that have the triangle, but not its corner.
Status BorderNormals::Send(const std::vector<Straddler>& straddlers) {
  for (const Straddler& straddler : straddlers) {
    TriangleRecord t;
    for (int k = 0; k < 3; ++k) t.vertices[k] = straddler.triangle.vertices[k];
    const glm::vec3& position = t.vertices[straddler.found.corner];
    const BorderNormal entry{straddler.id, (HashOfPosition(position) & ~3u) | straddler.found.corner,
                             straddler.found.normal};
    Status status;
    ForEachRegion(*tree_, t, padding_, [&](uint32_t region, const Box&) {
      if (status && !Contains(tree_->regions[region].cell, position)) status = files_.Append(region, &entry);
    });
    QUARRY_TRY(status);
  }
  return {};
}

Status BorderNormals::AddRegions(const RegionFiles& triangles, uint32_t first, uint32_t last,
                                 unsigned threads, const std::function<void(uint64_t)>& done) {
  struct Work {
    uint32_t region;
    std::future<Border> border;
  };
  std::deque<Work> works;
  const auto finish_first = [&]() -> Status {
    const SpillFile& file = triangles.file(works.front().region);
    QUARRY_TRY(SendAll(works.front().region, file, {}, works.front().border.get()));
    file.ForgetBlocks();
    done(file.count());
    works.pop_front();
    return {};
  };
  for (uint32_t region = first; region < last; ++region) {
    if (works.size() >= threads) QUARRY_TRY(finish_first());
    works.push_back({region, std::async(std::launch::async, [this, region, &triangles] {
                       return Find(region, triangles.file(region), {});
                     })});
  }
  while (!works.empty()) QUARRY_TRY(finish_first());
  return {};
}

}  // namespace quarry
