// Every structure of the laboratory against brute force, to the last bit, and the counts of kd-trees.
#include <catch2/catch.hpp>
#include <fstream>

#include "common/voxel/block_decoder.h"
#include "tests/laboratory/structures/grid.h"
#include "tests/laboratory/structures/kd_ways.h"
#include "tests/laboratory/structures/stack_trace.h"
#include "tests/laboratory/structures/store_tree.h"
#include "tests/laboratory/structures/test_rays.h"
#include "tests/support/rendering/flat_tree.h"
#include "tests/support/skip.h"

namespace quarry::laboratory {
namespace {

/// Counts, and the lists and triangles in their order.
struct Recording : TraceCounts {
  std::vector<uint32_t> visits;
  void List(const TriangleRange& range) {
    TraceCounts::List(range);
    visits.push_back(range.next);
    visits.push_back(range.end);
  }
  void Test(uint32_t triangle) {
    TraceCounts::Test(triangle);
    visits.push_back(triangle);
  }
};

/// Compares hits and counts of all ways through one tree for a ray; all checks but the last are of
/// section 4.1.
void CheckTree(const LaboratoryScene& scene, const TextureTree& tree, const KdRopes& ropes,
               const TestRay& ray, const Hit& expected) {
  PlainMemory memory;
  Recording stack, restart, backtrack, push_down, roped;
  CHECK(Same(expected, TraceWithStack(tree, scene.corners(), memory, ray.start, ray.t_end, stack)));
  CHECK(Same(expected, TraceOne(KdRestart(tree), scene.corners(), memory, ray.start, ray.t_end, restart)));
  CHECK(
      Same(expected, TraceOne(KdBacktrack(tree), scene.corners(), memory, ray.start, ray.t_end, backtrack)));
  CHECK(Same(expected, TraceOne(KdPushDown(tree), scene.corners(), memory, ray.start, ray.t_end, push_down)));
  CHECK(Same(expected, TraceOne(ropes, scene.corners(), memory, ray.start, ray.t_end, roped)));
  CHECK(restart.visits == stack.visits);
  CHECK(backtrack.visits == stack.visits);
  CHECK(push_down.visits == stack.visits);
  // The paper: "kd-backtrack's Down count is exactly the number of search steps that the stack-based approach
  // would have required". Its pseudocode searches the split again from which it resumes, where the stack has
  // the far child: one step more for each leaf after which the ray goes on.
  CHECK(backtrack.resumes == stack.resumes);
  CHECK(backtrack.steps == stack.steps + stack.resumes);
  // Up visits only splits that were visited on the way down, each at most twice (section 2.3).
  CHECK(backtrack.ups >= backtrack.resumes);
  CHECK(backtrack.ups <= 2 * stack.steps);
  // Each restart goes down the whole way; pushed down, at most as far.
  CHECK(restart.resumes == stack.resumes);
  CHECK(restart.steps <= (restart.resumes + 1) * tree.depth());
  CHECK(restart.steps >= backtrack.steps);
  CHECK(push_down.steps <= restart.steps);
  CHECK((restart.ups == 0 && push_down.ups == 0 && roped.ups == 0));
}

/// The cells of a ray follow each other by faces, in the order of the ray, each seen once.
void CheckCells(const UniformGrid& grid, const TestRay& ray) {
  PlainMemory memory;
  UniformGrid::Constant line;
  UniformGrid::State state{}, before;
  TriangleRange range;
  StepOutcome outcome = grid.Setup(memory, ray.start, 0, ray.t_end, line, state);
  float t = 0;
  for (bool first = true; outcome != StepOutcome::kOut; first = false) {
    if (!first) {
      int moved = 0;
      for (uint32_t a = 0; a < 3; ++a) {
        const int step = static_cast<int>(state.cell[a]) - static_cast<int>(before.cell[a]);
        CHECK((step == 0 || step == (line.Rises(a) ? 1 : -1)));
        moved += std::abs(step);
        CHECK(state.cell[a] < grid.resolution()[a]);
      }
      CHECK(moved == 1);
      CHECK(state.t_exit >= t);
      t = state.t_exit;
    } else {
      t = state.t_exit;
    }
    for (uint32_t a = 0; a < 3; ++a) {
      const uint32_t rises = line.Rises(a) ? 1 : 0;
      const uint32_t last = rises ? grid.resolution()[a] - 1 : 0;
      const bool at_border = first && state.cell[a] == grid.resolution()[a] - 1 - last;
      CHECK((at_border || line.PlaneAt(grid.Plane(a, state.cell[a] + 1 - rises), a) <= t));
      const float exit = line.PlaneAt(grid.Plane(a, state.cell[a] + rises), a);
      CHECK((exit > t || (!first && exit == t) || (first && state.cell[a] == last)));
    }
    before = state;
    outcome = grid.Step(memory, line, state, range);
    if (outcome == StepOutcome::kList) {
      CHECK(range.next < range.end);
      outcome = grid.Leave(memory, line, state, ray.t_end);
    }
  }
}

void CheckScene(LaboratoryScene& scene, int rays) {
  const Box box = scene.box();
  const KdTree plain[] = {BuildFoleyTree(scene.triangles(), scene.padding(), box),
                          Must(ReadStoreTree(scene))};
  const TextureTree theirs(plain[0], box, scene.addresses()), ours(plain[1], box, scene.addresses());
  const KdRopes their_ropes(plain[0], box, scene.addresses()), our_ropes(plain[1], box, scene.addresses());
  const UniformGrid coarse(scene.triangles(), scene.padding(), box, {2, 2, 2}, scene.addresses());
  const UniformGrid fine(scene.triangles(), scene.padding(), box, {50, 50, 50}, scene.addresses());
  const UniformGrid cubes(scene.triangles(), scene.padding(), box, CubicalResolution(box, 8),
                          scene.addresses());
  std::mt19937 random(11);
  PlainMemory memory;
  NoCounts none;
  int hits = 0;
  for (int i = 0; i < rays; ++i) {
    const TestRay ray = MakeRay(scene, random);
    CAPTURE(i, ray.start.origin, ray.start.direction, ray.t_end);
    const Hit expected = BruteForce(scene.corners(), memory, ray.start, ray.t_end);
    hits += expected.triangle != kNoTriangle ? 1 : 0;
    CheckTree(scene, theirs, their_ropes, ray, expected);
    CheckTree(scene, ours, our_ropes, ray, expected);
    for (const UniformGrid* grid : {&coarse, &fine, &cubes}) {
      CHECK(Same(expected, TraceOne(*grid, scene.corners(), memory, ray.start, ray.t_end, none)));
      CheckCells(*grid, ray);
    }
  }
  CHECK(hits > rays / 8);
}

}  // namespace

TEST_CASE("the papers' structures find the hits of brute force: terrain") {
  CheckScene(*Generated("terrain", 2000), 10000);
}

TEST_CASE("the papers' structures find the hits of brute force: a store of many voxels") {
  const MadeScene made = Generated("terrain", 20000, 16 << 10);
  const Catalog& catalog = made->catalog();
  CHECK(catalog.voxels.size() > 20);
  CheckScene(*made, 500);
  // Voxels outside of chains keep the leaves of their own trees.
  const KdTree tree = Must(ReadStoreTree(*made));
  std::vector<uint32_t> expected, found;
  const auto note = [](const std::vector<KdNode>& nodes, std::vector<uint32_t>& counts) {
    for (const KdNode& node : nodes)
      if (node.is_leaf()) counts.push_back(node.count());
  };
  BlockDecoder decoder;
  BlockMemory memory;
  uint32_t alone = 0;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
    if (catalog.chain_end[v] != v + 1 || (v > 0 && catalog.chain_end[v - 1] > v)) continue;
    ++alone;
    std::vector<KdNode> nodes;
    const BlockKey key = BlockKey::Hot(v);
    Must(DecodeHot(decoder, catalog, v, Must(made->store().ReadBlock(key)),
                   memory.Fit(catalog.block(key).decoded), &nodes));
    note(test::FlattenTreelets(nodes), expected);
  }
  for (const KdNode& node : test::FlattenTreelets(catalog.top_nodes))
    if (node.is_leaf() && node.count() == 0) expected.push_back(0);
  note(tree.nodes, found);
  std::ranges::sort(expected);
  std::ranges::sort(found);
  CHECK(alone > 20);
  CHECK(std::ranges::includes(found, expected));
}

TEST_CASE("the papers' structures find the hits of brute force: plant") {
  CheckScene(*Generated("plant", 3000), 10000);
}

TEST_CASE("the papers' structures find the hits of brute force: the papers' scenes") {
  const std::string folder = test::ScenesFolder();
  for (const auto& [model, rays] : {std::pair{"cornell/CornellBox-Original.obj", 2000},
                                    {"bart/scene_kitchen/kitchen.obj", 200},
                                    {"bart/scene_robot/robot.obj", 200}}) {
    const std::string path = folder + "/" + model;
    if (folder.empty() || !std::filesystem::exists(path)) {
      test::Skip("the model " + std::string(model) + " is not there");
      continue;
    }
    INFO(model);
    CheckScene(*MadeScene(path), rays);
  }
}

TEST_CASE("a tree of one leaf, a grid of one cell, a ray that misses the scene") {
  MadeScene loaded = Generated("terrain", 1000);
  LaboratoryScene& scene = *loaded;
  KdTree leaf;
  leaf.nodes = {KdNode::Leaf(0, static_cast<uint32_t>(scene.triangles().size()))};
  for (uint32_t i = 0; i < scene.triangles().size(); ++i) leaf.references.push_back(i);
  const TextureTree tree(leaf, scene.box(), scene.addresses());
  const KdRopes ropes(leaf, scene.box(), scene.addresses());
  const UniformGrid cell(scene.triangles(), scene.padding(), scene.box(), {1, 1, 1}, scene.addresses());
  std::mt19937 random(5);
  PlainMemory memory;
  NoCounts none;
  for (int i = 0; i < 500; ++i) {
    TestRay ray = MakeRay(scene, random);
    if (i == 0) {
      const glm::vec3 above = scene.box().upper + glm::vec3(1);
      ray = {{{above.x, above.y, above.z}, {0, 0, 1}}, NextBelow(kInfinity)};
    }
    const Hit expected = BruteForce(scene.corners(), memory, ray.start, ray.t_end);
    CHECK(Same(expected, TraceOne(KdRestart(tree), scene.corners(), memory, ray.start, ray.t_end, none)));
    CHECK(Same(expected, TraceOne(KdBacktrack(tree), scene.corners(), memory, ray.start, ray.t_end, none)));
    CHECK(Same(expected, TraceOne(KdPushDown(tree), scene.corners(), memory, ray.start, ray.t_end, none)));
    CHECK(Same(expected, TraceOne(ropes, scene.corners(), memory, ray.start, ray.t_end, none)));
    CHECK(Same(expected, TraceOne(cell, scene.corners(), memory, ray.start, ray.t_end, none)));
    CHECK(Same(expected, TraceWithStack(tree, scene.corners(), memory, ray.start, ray.t_end, none)));
  }
}

TEST_CASE("a store's tree has the voxels' leaves, and of a chain one tree") {
  // Triangles that share a point: no plane divides them, so that their leaf is a chain. Small ones lie beside
  // them, in voxels with trees.
  const test::TemporaryFolder folder;
  const std::string model = folder.file("star.obj");
  {
    std::ofstream out(model);
    std::mt19937 random(3);
    for (int i = 0; i < 3000; ++i) {
      out << "v 0.25 0.25 0.25\n";
      for (int c = 0; c < 2; ++c)
        out << "v " << test::Uniform(random, -1, 1) << ' ' << test::Uniform(random, -1, 1) << ' '
            << test::Uniform(random, -1, 1) << '\n';
      out << "f -3 -2 -1\n";
      const float place[3] = {test::Uniform(random, 2, 4), test::Uniform(random, -1, 1),
                              test::Uniform(random, -1, 1)};
      for (int corner = 0; corner < 3; ++corner) {
        out << 'v';
        for (const float x : place) out << ' ' << x + test::Uniform(random, -0.02, 0.02);
        out << '\n';
      }
      out << "f -3 -2 -1\n";
    }
  }
  const MadeScene made(model, 16 << 10);
  const Catalog& catalog = made->catalog();
  uint32_t longest = 0;
  for (uint32_t v = 0; v < catalog.chain_end.size(); ++v)
    longest = std::max(longest, catalog.chain_end[v] - v);
  CHECK(longest > 1);
  const KdTree tree = Must(ReadStoreTree(*made));
  CHECK(tree.nodes.size() > 2 * test::FlattenTreelets(catalog.top_nodes).size());
  size_t leaves = 0, splits = 0, references = 0;
  for (const KdNode& node : tree.nodes) {
    (node.is_leaf() ? leaves : splits) += 1;
    if (node.is_leaf()) references += node.count();
    if (!node.is_leaf()) CHECK(node.left() + 1 < tree.nodes.size());
  }
  CHECK(leaves == splits + 1);
  CHECK(references == tree.references.size());
  for (const uint32_t place : tree.references) CHECK(place < made->triangles().size());
  CheckScene(*made, 500);
}

TEST_CASE("the laboratory's trees keep their nodes, leaves and parents as textures") {
  MadeScene loaded = Generated("plant", 3000);
  const LaboratoryScene& scene = *loaded;
  AddressSpace addresses;
  const KdTree plain = BuildFoleyTree(scene.triangles(), scene.padding(), scene.box());
  const TextureTree tree(plain, scene.box(), addresses);
  CHECK(tree.splits() + tree.leaves() == plain.nodes.size());
  CHECK(tree.leaves() == tree.splits() + 1);
  CHECK(tree.references() == plain.references.size());
  CHECK(tree.depth() <= 8 + 1.3 * 12 + 1);
  for (uint32_t i = 0; i < tree.splits(); ++i) {
    const TextureNode& split = tree.nodes().data[i];
    const ExtendedSplit& more = tree.extended().data[i];
    CHECK(split.axis() < 3);
    CHECK((split.plane() > more.lower[split.axis()] && split.plane() < more.upper[split.axis()]));
    for (uint32_t side = 0; side < 2; ++side) {
      const NodePointer child = split.child(side);
      const NodePointer parent = child & kLeafBit ? tree.nodes().data[child & kPlaceBits].parent()
                                                  : tree.extended().data[child].parent;
      CHECK(parent == i);
    }
  }
}

}  // namespace quarry::laboratory
