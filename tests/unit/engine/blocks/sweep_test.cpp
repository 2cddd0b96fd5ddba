#include "common/engine/blocks/sweep.h"

#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "common/engine/blocks/voxel_cache.h"

namespace quarry {
namespace {

constexpr uint32_t kBlock = 1000;

/// Voxel 0 right of a plane across x; left of it voxel 1 below a plane across z, and above it the chain of 2
/// and 3. Each has a hot block alone, of 1000 bytes.
Catalog FourVoxels() {
  Catalog catalog;
  catalog.top_nodes = {KdNode::Inner(0, 0.5f, 1), KdNode::Inner(2, 0.5f, 3), KdNode::Leaf(0, 1),
                       KdNode::Leaf(1, 1), KdNode::Leaf(2, 1)};
  catalog.voxels.resize(4);
  for (VoxelEntry& voxel : catalog.voxels) voxel.blocks[0] = {0, kBlock, kBlock, 0};
  catalog.chain_end = {1, 2, 4, 4};
  return catalog;
}

std::vector<uint32_t> InOrder(const VoxelOrder& order, uint32_t octant) {
  std::vector<uint32_t> voxels(4);
  for (uint32_t v = 0; v < 4; ++v) voxels[order.place(octant, v)] = v;
  return voxels;
}

BlockKey Hot(uint32_t voxel) { return BlockKey::Hot(voxel); }

}  // namespace

TEST_CASE("Voxels are sorted as rays of an octant pass them, voxels of a chain by their numbers", "[sweep]") {
  const VoxelOrder order(FourVoxels());
  CHECK(InOrder(order, 0) == std::vector<uint32_t>{1, 2, 3, 0});
  CHECK(InOrder(order, 1) == std::vector<uint32_t>{0, 1, 2, 3});  // down in x
  CHECK(InOrder(order, 2) == InOrder(order, 0));                  // no plane across y
  CHECK(InOrder(order, 4) == std::vector<uint32_t>{2, 3, 1, 0});  // down in z
  CHECK(InOrder(order, 7) == std::vector<uint32_t>{0, 2, 3, 1});
}

TEST_CASE("A sweep visits one octant, then the next, and returns to passed voxels last", "[sweep]") {
  const VoxelOrder order(FourVoxels());
  Sweep sweep(order);
  const OctantMask up = OctantBit(1, 1, 1), down_x = OctantBit(-1, 1, 1);
  CHECK(sweep.Distance({Hot(1), up}) < sweep.Distance({Hot(2), up}));
  sweep.MoveTo({Hot(2), up});
  CHECK(sweep.Distance({Hot(3), up}) < sweep.Distance({Hot(0), up}));
  CHECK(sweep.Distance({Hot(0), up}) < sweep.Distance({Hot(0), down_x}));
  CHECK(sweep.Distance({Hot(3), down_x}) < sweep.Distance({Hot(1), up}));  // passed
  CHECK(sweep.Distance({Hot(2), up}) <= sweep.Distance({Hot(3), up}));     // not yet left
  CHECK(sweep.Distance({Hot(1), static_cast<OctantMask>(up | down_x)}) == sweep.Distance({Hot(1), down_x}));
  // A voxel's shading comes after its triangles.
  CHECK(sweep.Distance({Hot(2), up}) < sweep.Distance({BlockKey::Shading(2), up}));
  sweep.MoveTo({Hot(3), down_x});
  CHECK(sweep.Distance({Hot(1), up}) < sweep.Distance({Hot(0), down_x}));
}

TEST_CASE("The next block of a sweep is the wanted one at the least distance", "[sweep]") {
  const VoxelOrder order(FourVoxels());
  Sweep sweep(order);
  std::map<BlockKey, OctantMask> wanted;
  std::mt19937 random(5);
  CHECK_FALSE(sweep.Next([](BlockKey) { return false; }).has_value());
  for (int step = 0; step < 2000; ++step) {
    const uint32_t voxel = random() % 4;
    const BlockKey block = random() % 2 == 0 ? BlockKey::Hot(voxel) : BlockKey::Shading(voxel);
    const auto octants = static_cast<OctantMask>(random() % 255 + 1);
    OctantMask& known = wanted[block];
    sweep.Add({block, static_cast<OctantMask>(octants & ~known)});
    known |= octants;
    const BlockKey skipped = random() % 3 == 0 ? Hot(random() % 4) : BlockKey::Page(0);
    std::optional<BlockKey> nearest;
    for (const auto& [other, mask] : wanted)
      if (other != skipped &&
          (!nearest || sweep.Distance({other, mask}) < sweep.Distance({*nearest, wanted[*nearest]})))
        nearest = other;
    REQUIRE(sweep.Next([&](BlockKey other) { return other == skipped; }) == nearest);
    if (!nearest || random() % 2 == 0) continue;
    sweep.MoveTo({*nearest, wanted[*nearest]});
    sweep.Remove({*nearest, wanted[*nearest]});
    wanted.erase(*nearest);
  }
}

TEST_CASE("Blocks that do not fit the cache together are loaded one by one, in the sweep's order",
          "[sweep]") {
  const Catalog catalog = FourVoxels();
  int wants = 0;
  VoxelCache cache(
      catalog, kBlock, [&] { ++wants; }, [] {});
  Mailbox mailbox;
  const OctantMask up = OctantBit(1, 1, 1);
  cache.Want(Hot(0), &mailbox, 1000, up);  // most rays, but last on their way
  cache.Want(Hot(3), &mailbox, 1, up);
  cache.Want(Hot(1), &mailbox, 1, up);
  CHECK(cache.scarce());
  CHECK(cache.NextToLoad() == Hot(1));
  CHECK(cache.NextToLoad() == Hot(3));
  CHECK(cache.NextToPublish().block == Hot(1));
  REQUIRE(cache.Reserve(Hot(1)));
  const auto publish = [&](BlockKey block) {
    auto resident = std::make_unique<ResidentBlock>();
    resident->bytes = *cache.TakePages(kBlock);
    cache.Publish(block, std::move(resident));
  };
  publish(Hot(1));
  // No block is next before the rays that waited for this block have visited it and asked for their next
  // blocks.
  CHECK_FALSE(cache.NextToPublish().any);
  CHECK_FALSE(cache.NextToPublish().block.has_value());
  REQUIRE(mailbox.Take(false) == std::vector<BlockKey>{Hot(1)});
  CHECK_FALSE(cache.NextToPublish().block.has_value());
  cache.Want(Hot(2), &mailbox, 1, up);
  cache.Unpin(Hot(1));
  const int before = wants;
  CHECK(mailbox.Take(false).empty());
  CHECK(wants == before + 1);
  CHECK(cache.NextToPublish().block == Hot(2));
  // Block 2 has not been requested yet, and is ahead of the requested blocks.
  CHECK(cache.TurnToLoad() == Hot(2));
  CHECK_FALSE(cache.TurnToLoad().has_value());
}

TEST_CASE("Where all wanted blocks fit, the block with most waiting rays is loaded first", "[sweep]") {
  const Catalog catalog = FourVoxels();
  VoxelCache cache(
      catalog, 10 * kBlock, [] {}, [] {});
  Mailbox mailbox;
  cache.Want(Hot(1), &mailbox, 1, kAllOctants);
  cache.Want(Hot(0), &mailbox, 1000000, kAllOctants);
  CHECK_FALSE(cache.scarce());
  CHECK(cache.NextToPublish().any);
  CHECK(cache.NextToLoad() == Hot(0));
  CHECK_FALSE(cache.TurnToLoad().has_value());
}

}  // namespace quarry
