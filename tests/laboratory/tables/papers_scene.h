#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/ray_packet.h"
#include "tests/laboratory/scene.h"
#include "tests/laboratory/structures/grid.h"
#include "tests/laboratory/structures/kd_ways.h"
#include "tests/laboratory/structures/trace.h"

namespace quarry::laboratory {

/// The figures of Foley & Sugerman 2005 for one of their scenes. Times: milliseconds a frame, on an ATI X800
/// XT PE.
struct PaperFigures {
  const char* store;  ///< the store's name without .quarry
  const char* name;
  uint32_t triangles;
  GridResolution grid;
  double brute, grid_ms, restart, backtrack;
  /// Table 2, in millions; 0: not told.
  double restart_down, backtrack_down, up, intersect, transitions;
};
inline constexpr PaperFigures kPaperFigures[] = {
    {"frame-cornell", "Cornell Box", 32, {2, 2, 2}, 23, 63, 80, 84, 0, 0, 0, 0, 0},
    {"frame-bunny", "Bunny", 69451, {50, 50, 50}, 4620, 357, 701, 690, 0, 0, 0, 0, 0},
    {"frame-robots", "Robots", 71708, {50, 50, 50}, 4770, 8344, 968, 946, 31.68, 13.49, 9.80, 6.84, 2.48},
    {"frame-kitchen", "Kitchen", 110561, {50, 50, 50}, 7350, 2687, 992, 857, 21.80, 10.86, 7.78, 5.91, 2.13}};

/// Name of a structure in tables and JSON, over the paper's tree (0) or ours (1).
inline std::string NameOf(const char* way, size_t tree) {
  return way + std::string(tree == 0 ? "" : ", ours");
}

/// The figures of a store's scene; null for another scene.
const PaperFigures* FiguresOf(const std::string& store);

/// Memory that counts the words and the places read of textures. Streams are counted by the size of their
/// elements.
struct FetchCounter {
  uint64_t fetches = 0, words = 0;

  template <class T>
  const T& Fetch(const Texture<T>& texture, size_t i) {
    ++fetches;
    words += sizeof(T) / sizeof(uint32_t);
    return texture.data[i];
  }
};

/// The work of a structure for the rays of a frame.
struct FrameCounts : TraceCounts {
  uint64_t words = 0;  ///< of 32 bits, read from textures
};

/// A tree and the counts of its traversals for the rays of a frame.
struct TreeCounts {
  std::string name;  ///< "theirs" or "ours"
  uint64_t splits, leaves, references;
  uint32_t depth;
  double build_seconds;
  FrameCounts stack, restart, backtrack, push_down, ropes;
};

/// Seconds a frame of each repetition: of a processor, so that other programs on the core do not count, or
/// of a GPU.
struct Timing {
  std::string name;
  std::vector<double> seconds;
};

/// One scene with all structures of the paper.
class PapersScene {
 public:
  /// Whether Load() can load the store, but for blocks that are damaged.
  static Status Check(const std::string& store, uint32_t size);
  /// `size`: pixels on a side, a multiple of 8. The view is that of the camera beside the store.
  static Result<std::unique_ptr<PapersScene>> Load(const std::string& store, uint32_t size);

  LaboratoryScene& scene() const { return *scene_; }
  const std::string& name() const { return name_; }
  const PaperFigures* paper() const { return paper_; }
  uint64_t rays() const { return rays_.size(); }
  /// The primary rays that meet the scene's box, by tiles of 8x8 pixels.
  const std::vector<RayStart>& ray_list() const { return rays_; }
  const UniformGrid& grid() const { return *grid_; }
  /// 0: theirs; 1: ours.
  const TextureTree& tree(size_t which) const { return *trees_[which].tree; }

  // Each function below compares its hits with the hits of the structure that ran first. Errors: they differ.

  /// Counts, ray by ray.
  Result<std::vector<TreeCounts>> CountTrees();
  Result<FrameCounts> CountGrid();
  /// Times brute force, grid, restart and backtrack over their tree, then over ours, on one core. Brute force
  /// can be left out.
  Result<std::vector<Timing>> Time(int repetitions, bool brute_force);

  /// The frame's rays, and for each packet the bits of the rays that meet the scene's box.
  const std::vector<RayPacket>& packets() const { return packets_; }
  const std::vector<uint64_t>& active() const { return active_; }
  /// How many of the frame's rays have other hits in `found` than the first structure. Requires: one has run;
  /// `found` has the packets of the frame.
  uint64_t Differences(const std::vector<RayPacket>& found) const;
  const KdRopes& ropes(size_t which) const { return *trees_[which].ropes; }

 private:
  struct Tree {
    std::unique_ptr<TextureTree> tree;
    std::unique_ptr<KdRopes> ropes;
    double build_seconds = 0;
  };
  /// Calls f(place in rays_, packet, lane) for the rays of ray_list().
  template <class F>
  void ForRays(const F& f) const;
  template <class TraceRay>
  Result<FrameCounts> Count(const TraceRay& trace);

  std::string name_;
  const PaperFigures* paper_ = nullptr;
  std::unique_ptr<LaboratoryScene> scene_;
  std::vector<RayPacket> packets_;
  std::vector<uint64_t> active_;
  std::vector<RayStart> rays_;
  std::vector<Hit> hits_;  ///< of rays_, from the first structure
  std::unique_ptr<UniformGrid> grid_;
  Tree trees_[2];
};

}  // namespace quarry::laboratory
