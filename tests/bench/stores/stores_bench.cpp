// Figures of a store: its size against its decoded size, the speed of decoding, the replication of triangles
// by voxels, and the SAH cost of its two levels beside the cost of one tree over all triangles by the same
// builder. One thread. 20 M triangles take about 6 GB.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/base/log.h"
#include "common/base/resource.h"
#include "common/kdtree/build/treelets.h"
#include "common/program/run_program.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_reader.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/support/rendering/flat_tree.h"

namespace quarry::bench {
namespace {

/// Of this thread's processor: other work on the machine counts for nothing.
double ProcessorSeconds() { return static_cast<double>(ThreadTimeUs()) * 1e-6; }

constexpr double kMega = 1e6;
constexpr int kRepetitions = 5;
constexpr uint32_t kBatch = 256;  // voxels read at a time, so that decoding alone is timed

/// Expected traversal steps and intersections of a ray that meets the root, in traversal steps.
class SahCost {
 public:
  explicit SahCost(const Box& root) : root_area_(Area(root)) {}

  /// Adds the tree's cost; `leaf(node, cell)` adds the cost of a leaf.
  template <class Leaf>
  void Add(std::span<const KdNode> nodes, const Box& cell, Leaf&& leaf, uint32_t index = 0) {
    const KdNode node = nodes[index];
    if (node.is_leaf()) return leaf(node, cell);
    cost_ += Area(cell) / root_area_;
    Box child[2] = {cell, cell};
    child[0].upper[node.axis()] = child[1].lower[node.axis()] = node.split();
    for (uint32_t side = 0; side < 2; ++side) Add(nodes, child[side], leaf, node.left() + side);
  }
  void AddReferences(const Box& cell, uint32_t count) {
    cost_ += Area(cell) / root_area_ * SahCosts{}.intersect * count;
  }
  double value() const { return cost_; }

 private:
  static double Area(const Box& b) {
    const double x = b.extent(0), y = b.extent(1), z = b.extent(2);
    return x * y + y * z + z * x;
  }
  double root_area_, cost_ = 0;
};

struct Figures {
  uint64_t triangles = 0, voxels = 0, references = 0, stored = 0, decoded = 0, store_bytes = 0;
  uint64_t shading_decoded = 0;
  double decode_s = 0, shading_s = 0, two_level = 0, one_level = 0;
};

class StoreBench {
 public:
  explicit StoreBench(StoreReader store) : store_(std::move(store)) {
    const SceneMeta& meta = store_.catalog().meta;
    root_ = {meta.root_lower, meta.root_upper};
  }

  Result<Figures> Run(bool one_level) {
    const Catalog& catalog = store_.catalog();
    Figures f;
    f.voxels = catalog.voxels.size();
    f.store_bytes = store_.size();
    for (const VoxelEntry& v : catalog.voxels) {
      f.references += v.triangles;
      f.stored += v.blocks[0].stored;
      f.decoded += v.blocks[0].decoded;
      f.shading_decoded += v.blocks[1].decoded;
    }
    std::vector<double> times, shading_times;
    for (int i = 0; i < kRepetitions; ++i) {
      double seconds = 0, shading_seconds = 0;
      QUARRY_TRY(ForEachVoxel(seconds, nullptr, [](uint32_t, const VoxelGeometry&) {}));
      QUARRY_TRY(DecodeShading(shading_seconds));
      times.push_back(seconds);
      shading_times.push_back(shading_seconds);
    }
    f.decode_s = Median(times);
    f.shading_s = Median(shading_times);
    QUARRY_TRY(MeasureTwoLevels(f, one_level));
    if (one_level) {
      const KdTree tree = BuildKdTree(triangles_, catalog.meta.padding, root_, SahCosts{}, ~size_t{0} / 2);
      SahCost cost(root_);
      cost.Add(tree.nodes, root_, [&](KdNode leaf, const Box& c) { cost.AddReferences(c, leaf.count()); });
      f.one_level = cost.value();
    }
    return f;
  }

 private:
  /// Decodes every voxel; `seconds`: of decoding alone, checksum not included. `tree`: where its nodes go.
  template <class Visit>
  Status ForEachVoxel(double& seconds, std::vector<KdNode>* tree, Visit&& visit) {
    const Catalog& catalog = store_.catalog();
    std::vector<std::byte> out(catalog.meta.largest_decoded + 16);
    void* at = out.data();
    size_t room = out.size();
    auto* aligned = static_cast<std::byte*>(std::align(16, catalog.meta.largest_decoded, at, room));
    for (uint32_t first = 0; first < catalog.voxels.size(); first += kBatch) {
      const uint32_t end = std::min<uint32_t>(first + kBatch, static_cast<uint32_t>(catalog.voxels.size()));
      std::vector<Bytes> blocks;
      for (uint32_t v = first; v < end; ++v) {
        QUARRY_ASSIGN(Bytes block, store_.ReadBlock(BlockKey::Hot(v)));
        blocks.push_back(std::move(block));
      }
      for (uint32_t v = first; v < end; ++v) {
        const double begin = ProcessorSeconds();
        QUARRY_ASSIGN(const VoxelGeometry voxel,
                      decoder_.Hot(blocks[v - first], {aligned, catalog.voxels[v].blocks[0].decoded},
                                   catalog.meta.padding, tree));
        seconds += ProcessorSeconds() - begin;
        visit(v, voxel);
      }
    }
    return {};
  }

  /// Decodes every shading block; `seconds`: of decoding alone.
  Status DecodeShading(double& seconds) {
    const Catalog& catalog = store_.catalog();
    Bytes out;
    for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
      const BlockEntry& entry = catalog.block(BlockKey::Shading(v));
      if (entry.stored == 0) continue;
      QUARRY_ASSIGN(const Bytes block, store_.ReadBlock(BlockKey::Shading(v)));
      out.resize(std::max<size_t>(out.size(), entry.decoded));
      const double begin = ProcessorSeconds();
      QUARRY_TRY(decoder_.Shading(block, std::span(out).first(entry.decoded)));
      seconds += ProcessorSeconds() - begin;
    }
    return {};
  }

  /// Voxels' costs, and the distinct triangles if they are wanted.
  Status MeasureTwoLevels(Figures& f, bool keep) {
    const Catalog& catalog = store_.catalog();
    std::vector<Box> cells(catalog.voxels.size());
    SahCost cost(root_);
    cost.Add(test::FlattenTreelets(catalog.top_nodes), root_, [&](KdNode leaf, const Box& cell) {
      if (leaf.count() == 0) return;
      for (uint32_t v = leaf.first(); v != kNoIndex; v = catalog.voxels[v].next_in_chain) cells[v] = cell;
    });
    std::vector<bool> seen(catalog.meta.input_triangles);
    double ignored = 0;
    std::vector<KdNode> tree;
    return ForEachVoxel(ignored, &tree, [&](uint32_t v, const VoxelGeometry& g) {
      const std::vector<KdNode> nodes = test::FlattenTreelets({g.nodes, g.node_count});
      cost.Add(nodes, cells[v], [&](KdNode leaf, const Box& c) { cost.AddReferences(c, leaf.count()); });
      f.two_level = cost.value();
      for (uint32_t t = 0; t < g.triangle_count; ++t) {
        if (seen[g.triangle_ids[t]]) continue;
        seen[g.triangle_ids[t]] = true;
        ++f.triangles;
        if (keep) triangles_.push_back({{g.vertex(t, 0), g.vertex(t, 1), g.vertex(t, 2)}});
      }
    });
  }

  StoreReader store_;
  BlockDecoder decoder_;
  Box root_;
  std::vector<KdTriangle> triangles_;
};

int Main(int argc, char** argv) {
  std::vector<std::string> stores;
  std::string json;
  bool one_level = false;
  CLI::App app("What stores are worth: size, decoding, replication, SAH cost.");
  app.add_option("store", stores, "Stores made by quarry-preprocess")->required();
  app.add_flag("--one-level", one_level, "Also the SAH cost of one tree over all triangles");
  app.add_option("--json", json, "Results as JSON")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  nlohmann::ordered_json results = nlohmann::ordered_json::array();
  Print(fmt::format("{:20} {:>10} {:>8} {:>12} {:>8} {:>12} {:>8} {:>13} {:>12} {:>10} {:>10} {:>7}\n",
                    "store", "triangles", "voxels", "bytes/tri", "decoded", "decode MB/s", "ns/tri",
                    "shading MB/s", "replication", "SAH", "one level", "ratio"));
  for (const std::string& path : stores) {
    auto store = StoreReader::Open(path);
    const auto f =
        store ? StoreBench(std::move(*store)).Run(one_level) : Result<Figures>(Fail(store.error().message));
    if (!f) {
      Log(fmt::format("quarry-bench-stores: {}", f.error().message));
      return 1;
    }
    const auto triangles = static_cast<double>(f->triangles);
    const double per_triangle = static_cast<double>(f->stored) / triangles,
                 ratio = static_cast<double>(f->decoded) / static_cast<double>(f->stored),
                 speed = static_cast<double>(f->decoded) / f->decode_s / kMega,
                 ns = f->decode_s / triangles * 1e9,
                 shading_speed = static_cast<double>(f->shading_decoded) / f->shading_s / kMega,
                 replication = static_cast<double>(f->references) / triangles;
    const std::string name = std::filesystem::path(path).stem().string();
    Print(fmt::format(
        "{:20} {:10} {:8} {:12.2f} {:7.1f}x {:12.0f} {:8.1f} {:>13} {:12.3f} {:10.2f} {:10} {:>7}\n", name,
        f->triangles, f->voxels, per_triangle, ratio, speed, ns,
        f->shading_decoded != 0 ? fmt::format("{:.0f}", shading_speed) : "", replication, f->two_level,
        one_level ? fmt::format("{:.2f}", f->one_level) : "",
        one_level ? fmt::format("{:.3f}", f->two_level / f->one_level) : ""));
    nlohmann::ordered_json j = {{"store", name},
                                {"triangles", f->triangles},
                                {"voxels", f->voxels},
                                {"hot_stored_bytes", f->stored},
                                {"hot_decoded_bytes", f->decoded},
                                {"decode_mb_per_s", speed},
                                {"decode_ns_per_triangle", ns},
                                {"replication", replication},
                                {"sah_two_level", f->two_level}};
    if (f->shading_decoded != 0) j["shading_decode_mb_per_s"] = shading_speed;
    if (one_level) j["sah_one_level"] = f->one_level;
    results.push_back(j);
  }
  return bench::WriteFigures(json, results.dump(2)) ? 0 : 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench stores", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}
