#include "preprocess/partition/partition.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <glm/vector_relational.hpp>
#include <random>
#include <tuple>

#include "common/kdtree/build/prune.h"
#include "preprocess/partition/sample.h"
#include "preprocess/partition/split.h"
#include "preprocess/partition/voxel_builder.h"
#include "preprocess/spill/paged_file.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

constexpr float kPadding = 1e-4f;
const Region kCube{{glm::vec3(-0.1f), glm::vec3(1.1f)}};

std::vector<TriangleRecord> Triangles(uint32_t count, float size) {
  std::mt19937 random(3);
  const auto unit = [&] { return static_cast<float>(random()) * 0x1p-32f; };
  std::vector<TriangleRecord> all(count);
  for (uint32_t i = 0; i < count; ++i) {
    const glm::vec3 at(unit() * (1 - size), unit() * (1 - size), unit() * (1 - size));
    for (glm::vec3& v : all[i].vertices) v = at + size * glm::vec3(unit(), unit(), unit());
    all[i].id = i;
  }
  return all;
}

std::vector<KdTriangle> Vertices(const std::vector<TriangleRecord>& records) {
  std::vector<KdTriangle> triangles;
  for (const TriangleRecord& r : records)
    triangles.push_back({{r.vertices[0], r.vertices[1], r.vertices[2]}});
  return triangles;
}

/// The leaf's payload where `p` lies.
KdNode LeafAt(const std::vector<KdNode>& nodes, const glm::vec3& p) {
  KdNode node = nodes[0];
  while (!node.is_leaf()) node = nodes[node.left() + (p[node.axis()] > node.split())];
  return node;
}

glm::vec3 Centre(const KdTriangle& t) { return (t.vertices[0] + t.vertices[1] + t.vertices[2]) / 3.0f; }

}  // namespace

TEST_CASE("Pruned trees are small enough and lose no triangle") {
  const auto triangles = Vertices(Triangles(3000, 0.05f));
  const KdTree whole = BuildKdTree(triangles, kPadding, kCube.cell, SahCosts{}, ~size_t{0} / 2);
  const size_t bytes = whole.nodes.size() * 8 + whole.references.size() * 2;
  for (const size_t most : {bytes, bytes / 2, bytes / 4, size_t{0}}) {
    KdTree tree = whole;
    PruneKdTree(tree, kCube.cell, SahCosts{}, most);
    const size_t left = tree.nodes.size() * 8 + tree.references.size() * 2;
    CHECK((left <= most || tree.nodes.size() == 1));
    CHECK(left >= most / 2);  // no more than need be
    size_t lost = 0, twice = 0;
    for (uint32_t i = 0; i < triangles.size(); ++i) {
      const KdNode leaf = LeafAt(tree.nodes, Centre(triangles[i]));
      const auto first = tree.references.begin() + leaf.first();
      const auto found = std::count(first, first + leaf.count(), i);
      lost += found == 0;
      twice += found > 1;
    }
    CHECK(lost == 0);
    CHECK(twice == 0);
  }
  // Splits whose removal costs nothing are removed even where there is room.
  KdTree tree = whole;
  PruneKdTree(tree, kCube.cell, SahCosts{.byte = 0.02f}, ~size_t{0});
  CHECK(tree.nodes.size() < whole.nodes.size());
}

TEST_CASE("A sample is the same whatever the order") {
  std::vector<TriangleRecord> records = Triangles(1, 1);
  const auto sizes = [&](bool backwards) {
    TriangleSample sample;
    constexpr uint32_t kCount = 3u << 20;
    double sum = 0;
    for (uint32_t i = 0; i < kCount; ++i) {
      records[0].id = backwards ? kCount - 1 - i : i;
      records[0].vertices[0].x = static_cast<float>(records[0].id);
      sample.Add(records[0]);
    }
    const uint64_t weight = sample.weight();
    const auto taken = sample.TakeTriangles();
    for (const KdTriangle& t : taken) sum += static_cast<double>(t.vertices[0].x);
    CHECK(taken.size() <= TriangleSample::kMost);
    CHECK(static_cast<double>(taken.size() * weight) == Approx(kCount).epsilon(0.02));
    return std::pair(taken.size(), sum);
  };
  CHECK(sizes(false) == sizes(true));
}

TEST_CASE("Empty space around regions and groups of them is cut off, and nothing else") {
  // Four regions in a row along x; the two at the end hold little, the second nothing.
  const Box whole{glm::vec3(0), glm::vec3(8, 8, 8)};
  RegionTree tree;
  tree.nodes = {KdNode::Inner(0, 4, 1), KdNode::Inner(0, 2, 3), KdNode::Inner(0, 6, 5), KdNode::Leaf(0, 1),
                KdNode::Leaf(1, 1),     KdNode::Leaf(2, 1),     KdNode::Leaf(3, 1)};
  tree.leaves = {3, 4, 5, 6};
  for (float x : {0.0f, 2.0f, 4.0f, 6.0f})
    tree.regions.push_back({{glm::vec3(x, 0, 0), glm::vec3(x + 2, 8, 8)}});
  const std::vector<Box> contents{
      {glm::vec3(0), glm::vec3(2, 8, 8)}, EmptyBox(), {{4.1f, 1, 2}, {6, 2, 3}}, {{6, 1, 2}, {6.5f, 2, 3}}};
  CutOffEmptySpace(contents, whole, tree);
  std::mt19937 random(5);
  const auto within = [](const Box& box, const glm::vec3& p) {
    return glm::all(glm::lessThanEqual(box.lower, p)) && glm::all(glm::lessThanEqual(p, box.upper));
  };
  size_t wrong = 0, empty = 0;
  for (int i = 0; i < 10000; ++i) {
    const glm::vec3 p = 8.0f * 0x1p-32f * glm::vec3(random(), random(), random());
    uint32_t node = 0;
    while (!tree.nodes[node].is_leaf()) {
      const KdNode& n = tree.nodes[node];
      node = n.left() + (p[n.axis()] > n.split() ? 1 : 0);
    }
    const KdNode& leaf = tree.nodes[node];
    const auto at =
        std::find_if(contents.begin(), contents.end(), [&](const Box& b) { return within(b, p); });
    if (leaf.count() == 0) {
      ++empty;
      wrong += at != contents.end();
    } else {
      wrong += tree.leaves[leaf.first()] != node || !within(tree.regions[leaf.first()].cell, p);
      wrong += at != contents.end() && at - contents.begin() != leaf.first();
    }
  }
  CHECK(wrong == 0);
  CHECK(empty > 4900);  // most of the right half
}

TEST_CASE("Planes chosen from a sample lie at borders of bins, and divide it into regions") {
  constexpr uint64_t kWeight = 1024;
  std::vector<TriangleRecord> spread = Triangles(8000, 0.02f), clusters = spread, outlier = spread,
                              flat = spread;
  for (uint32_t i = 0; i < spread.size(); ++i)
    for (glm::vec3& v : clusters[i].vertices) v = v * 0.2f + glm::vec3(i % 2 == 0 ? 0.0f : 0.7f);
  for (uint32_t i = 1; i < spread.size(); ++i)
    for (glm::vec3& v : outlier[i].vertices) v *= 0.01f;
  for (TriangleRecord& r : flat)
    for (glm::vec3& v : r.vertices) v.z = 0.5f;
  for (const auto& [name, records, bins] :
       {std::tuple("spread", spread, true), std::tuple("clusters", clusters, true),
        std::tuple("outlier", outlier, false), std::tuple("flat", flat, false)}) {
    INFO(name);
    const RegionTree tree = ChooseRegions(Vertices(records), kWeight, kPadding, kCube);
    CHECK(tree.regions.size() > records.size() * kWeight / kRegionTriangles);
    CHECK(tree.regions.size() < 200);
    size_t beside_borders = 0;
    const auto walk = [&](const auto& self, uint32_t at, const Box& cell) -> void {
      const KdNode n = tree.nodes[at];
      if (n.is_leaf()) {
        const Region& region = tree.regions[n.first()];
        CHECK((region.cell.lower == cell.lower && region.cell.upper == cell.upper));
        CHECK(region.depth <= kMaxTopDepth);
        uint64_t inside = 0;
        for (const TriangleRecord& r : records) {
          const Box box = r.PaddedBox(kPadding);
          inside += glm::all(glm::lessThanEqual(box.lower, cell.upper)) &&
                    glm::all(glm::lessThanEqual(cell.lower, box.upper));
        }
        CHECK(inside * kWeight <=
              kRegionTriangles + kRegionTriangles / 4);  // boxes reach a little further than triangles
        return;
      }
      REQUIRE((n.split() > cell.lower[n.axis()] && n.split() < cell.upper[n.axis()]));
      const float place = (n.split() - cell.lower[n.axis()]) / cell.extent(n.axis()) * 32;
      beside_borders += std::fabs(place - std::round(place)) > 1e-3f;
      const SplitCells child(cell, {n.axis(), n.split()});
      self(self, n.left(), child.cell[0]);
      self(self, n.left() + 1, child.cell[1]);
    };
    walk(walk, 0, kCube.cell);
    if (bins) CHECK(beside_borders == 0);
  }
}

TEST_CASE("Regions hold every triangle that touches their cells, in order, and continue where they stopped") {
  const test::TemporaryFolder folder;
  const auto records = Triangles(400000, 0.02f);
  auto spill = SpillFile::Open(folder.file("all"), RecordBytes(Attributes::kNone), 0);
  REQUIRE(spill.has_value());
  for (const TriangleRecord& r : records) REQUIRE(spill->Append(&r));
  REQUIRE(spill->FinishWriting());
  const RegionTree tree = ChooseRegions(Vertices(records), 1, kPadding, kCube);
  REQUIRE(tree.regions.size() > 2);
  const auto nothing = [](uint64_t) {};
  std::vector<uint64_t> counts;
  std::vector<Box> contents;
  {
    auto files = RegionFiles::Open(tree, folder.file("r-"), spill->element_bytes(), 1 << 20, 0, {}, {});
    REQUIRE(files.has_value());
    REQUIRE(files->Add(*spill, 0, 150000, kPadding, nothing));
    REQUIRE(files->WriteOut());
    counts = files->counts();
    contents = files->contents();
    REQUIRE(files->Add(*spill, 150000, 170000, kPadding, nothing));  // lost
    REQUIRE(files->FinishWriting());
  }
  auto files =
      RegionFiles::Open(tree, folder.file("r-"), spill->element_bytes(), 1 << 20, 0, counts, contents);
  REQUIRE(files.has_value());
  REQUIRE(files->Add(*spill, 150000, records.size(), kPadding, nothing));
  REQUIRE(files->FinishWriting());
  std::vector<bool> seen(records.size());
  for (size_t i = 0; i < tree.regions.size(); ++i) {
    const Box& cell = tree.regions[i].cell;
    uint32_t next = 0;
    size_t wrong = 0;
    REQUIRE(ForEachRecord(files->file(i), 0, files->file(i).count(), [&](const TriangleRecord& r) -> Status {
      const Box box = r.PaddedBox(kPadding);
      for (int a = 0; a < 3; ++a) wrong += box.lower[a] > cell.upper[a] || box.upper[a] < cell.lower[a];
      wrong += r.id < next || r.vertices[1] != records[r.id].vertices[1];
      next = r.id + 1;
      seen[r.id] = true;
      return {};
    }));
    CHECK(wrong == 0);
  }
  CHECK(std::count(seen.begin(), seen.end(), false) == 0);
}

TEST_CASE("The partition gives voxels of the size allowed, none twice, every triangle in its own") {
  const auto records = Triangles(60000, 0.02f);
  std::vector<VoxelTask> tasks;
  const PartitionOptions options{kPadding, 64 << 10, 0, ""};
  const auto tree = PartitionInMemory(records, kCube, options, [&](VoxelTask task) -> Status {
    tasks.push_back(std::move(task));
    return {};
  });
  REQUIRE(tree.has_value());
  REQUIRE(tasks.size() == tree->voxels);
  for (const VoxelTask& task : tasks) REQUIRE(task.triangles.size() <= MaxTrianglesPerVoxel(64 << 10));
  size_t lost = 0;
  const auto triangles = Vertices(records);
  for (uint32_t i = 0; i < records.size(); ++i) {
    const KdNode leaf = LeafAt(tree->nodes, Centre(triangles[i]));
    bool found = false;
    if (leaf.count() > 0)
      for (const TriangleRecord& r : tasks[leaf.first()].triangles) found |= r.id == i;
    lost += !found;
  }
  CHECK(lost == 0);
}

TEST_CASE("Paged files return the appended bytes, from memory or disk") {
  const test::TemporaryFolder folder;
  auto file = PagedFile::Create(folder.file("paged"), sizeof(uint64_t));
  REQUIRE(file.has_value());
  constexpr uint32_t kCount = PagedFile::kPageElements * (PagedFile::kSlots + 40) + 7;
  for (uint64_t i = 0; i < kCount; ++i) REQUIRE(file->Append(&i));
  CHECK(file->Find(kCount - 1));
  CHECK_FALSE(file->Find(0));
  std::mt19937 random(5);
  size_t wrong = 0;
  for (int i = 0; i < 20000; ++i) {
    const auto index = static_cast<uint32_t>(random() % kCount);
    if (!file->Find(index)) REQUIRE(file->Load(index));
    uint64_t value = 0;
    std::memcpy(&value, file->Find(index), sizeof value);
    wrong += value != index;
    if (i % 100 == 0) {  // the last page grows and stays
      const uint64_t next = file->count();
      REQUIRE(file->Append(&next));
      wrong += !file->Find(static_cast<uint32_t>(next));
    }
  }
  CHECK(wrong == 0);
}

}  // namespace quarry
