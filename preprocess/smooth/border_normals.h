#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/partition/regions.h"
#include "preprocess/smooth/corner_fans.h"
#include "preprocess/spill/spill_files.h"

namespace quarry {

/// The normal of a corner outside a region, of a triangle inside the region.
struct BorderNormal {
  uint32_t id = 0;           ///< of the triangle
  uint32_t hash_corner = 0;  ///< upper 30 bits of HashOfPosition(), and the corner
  uint32_t normal = 0;       ///< packed

  uint32_t hash() const { return hash_corner & ~3u; }
  uint32_t corner() const { return hash_corner & 3; }
};

/// A share of all positions, by their hashes: one pass over a region handles the corners of one share, so
/// that each pass takes the same memory.
struct HashShare {
  uint32_t pass = 0, passes = 1;

  /// The number of shares for a number of triangles.
  static uint32_t PassesFor(uint64_t triangles) {
    return static_cast<uint32_t>(triangles / (kMostInMemory + 1) + 1);
  }
  /// `hash`: HashOfPosition(); its lowest two bits are ignored.
  bool Has(uint32_t hash) const { return (hash >> 2) % passes == pass; }
  /// One of kParts parts of this share.
  static constexpr uint32_t kParts = 8;
  HashShare Part(uint32_t part) const { return {pass + part * passes, passes * kParts}; }
};

/// Whether a point lies in a closed cell.
inline bool Contains(const Box& cell, const glm::vec3& p) {
  return p.x >= cell.lower.x && p.y >= cell.lower.y && p.z >= cell.lower.z && p.x <= cell.upper.x &&
         p.y <= cell.upper.y && p.z <= cell.upper.z;
}

/// The normals that regions must exchange. A region has every triangle at the positions in its cell, so it
/// alone can find the normals there. A triangle that lies in several regions needs the normals of all its
/// corners in each. Each region has a file for the normals of corners outside its cell. Memory: kThreadBytes
/// for each thread at most. Thread safety: none.
class BorderNormals {
 public:
  /// Bytes of a thread: kMostStraddlers of 52 bytes in a vector that doubles, kMostCorners of 40 bytes.
  static constexpr uint64_t kThreadBytes = 48 << 20;

  /// `tree` and `regions`, whose files are complete, must outlive the object. Units: crease in degrees.
  /// `options`: as for all files of border normals. Errors: as SpillFiles::Open()'s.
  static Result<BorderNormals> Open(const RegionTree& tree, const std::string& prefix, float padding,
                                    double crease, const SpillFiles::Options& options);

  /// Finds the normals on the borders of the regions [first, last) for all other regions, on `threads`
  /// threads. `done` is called with the triangles of each. Errors: disk full; read errors.
  Status AddRegions(const RegionFiles& triangles, uint32_t first, uint32_t last, unsigned threads,
                    const std::function<void(uint64_t)>& done);
  SpillFiles& files() { return files_; }
  const SpillFiles& files() const { return files_; }

 private:
  BorderNormals(const RegionTree& tree, float padding, double crease, SpillFiles files)
      : tree_(&tree), padding_(padding), crease_(crease), files_(std::move(files)) {}
  /// A triangle in several regions, and a corner of it.
  struct Straddler {
    KdTriangle triangle;
    uint32_t id;
    CornerNormal found;
  };
  /// The result of a pass over a region. `too_many`: more straddlers than fit the memory; the pass must be
  /// split.
  struct Border {
    std::vector<Straddler> straddlers;
    bool too_many = false;
    Status status;
  };
  /// Corners of one pass on the border, and all corners at their positions.
  static constexpr size_t kMostStraddlers = 128 << 10, kMostCorners = 768 << 10;
  Border Find(uint32_t region, const SpillFile& triangles, const HashShare& share) const;
  uint32_t WantedCorners(uint32_t region, const TriangleRecord& t, const HashShare& share) const;
  Status SendAll(uint32_t region, const SpillFile& triangles, const HashShare& share, const Border& border);
  Status Send(const std::vector<Straddler>& straddlers);

  const RegionTree* tree_;
  float padding_;
  double crease_;
  SpillFiles files_;
};

}  // namespace quarry
