#include "tests/support/rendering/resident_scene.h"

#include <sys/mman.h>

#include <algorithm>
#include <bit>

#include "common/base/check.h"
#include "tests/support/rendering/flat_tree.h"
#include "tests/support/rendering/ropes.h"

namespace quarry::test {
namespace {

/// The voxel's cell: the box of the first treelet; any box for a tree of one leaf.
Box CellOf(const KdNode* nodes) {
  if (nodes[0].is_leaf()) return {glm::vec3(-1e30f), glm::vec3(1e30f)};
  const TreeletHeader& header = HeaderOf(nodes, nodes[0].left());
  return {glm::vec3(header.lower[0], header.lower[1], header.lower[2]),
          glm::vec3(header.upper[0], header.upper[1], header.upper[2])};
}

/// A finder to which only the granted voxels are resident.
struct Granting {
  const SceneView& view;
  std::vector<bool> granted;
  uint64_t refused = 0;

  static const VoxelGeometry* Find(void* context, uint32_t voxel) {
    auto& self = *static_cast<Granting*>(context);
    if (self.granted[voxel]) return &self.view.voxels()[voxel];
    ++self.refused;
    return nullptr;
  }
};

}  // namespace

GuardedBytes::GuardedBytes(size_t size) {
  constexpr size_t kPage = 4096;
  const size_t inside = (size + kPage - 1) / kPage * kPage;
  void* memory = ::mmap(nullptr, inside + 2 * kPage, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  QUARRY_CHECK(memory != MAP_FAILED);
  mapping_ = {static_cast<std::byte*>(memory), inside + 2 * kPage};
  QUARRY_CHECK(inside == 0 || ::mprotect(&mapping_[kPage], inside, PROT_READ | PROT_WRITE) == 0);
  bytes_ = mapping_.subspan(kPage + (inside - size) / 16 * 16, size);
}

GuardedBytes::~GuardedBytes() {
  if (!mapping_.empty()) ::munmap(mapping_.data(), mapping_.size());
}

Result<std::unique_ptr<ResidentScene>> ResidentScene::Load(const std::string& path) {
  auto scene = std::make_unique<ResidentScene>();
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(path));
  scene->store_ = std::make_unique<StoreReader>(std::move(store));
  const Catalog& catalog = scene->catalog();
  scene->views_[0] = std::make_unique<SceneView>();
  SceneView& view = *scene->views_[0];
  view.top_ = catalog.top_tree();
  view.top_node_slots_ = static_cast<uint32_t>(catalog.top_nodes.size());
  view.voxels_.reserve(catalog.voxels.size());
  BlockDecoder decoder;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
    const auto id = BlockKey::Hot(v);
    QUARRY_ASSIGN(const Bytes stored, scene->store_->ReadBlock(id));
    const std::span<std::byte> bytes = scene->bytes_.emplace_back(catalog.block(id).decoded).bytes();
    QUARRY_ASSIGN(const VoxelGeometry geometry,
                  DecodeHot(decoder, catalog, v, stored, bytes, &view.nodes_.emplace_back()));
    view.voxels_.push_back(geometry);
    scene->decoded_bytes_ += bytes.size();
  }
  return scene;
}

void ResidentScene::SetMasks(const std::function<uint32_t(uint32_t id)>& mask_of,
                             std::vector<FineMask> fine) {
  fine_masks_ = std::move(fine);
  for (VoxelGeometry& voxel : views_[0]->voxels_) {
    std::vector<uint32_t>& masks = masks_.emplace_back(voxel.triangle_count);
    for (uint32_t t = 0; t < voxel.triangle_count; ++t) masks[t] = mask_of(voxel.triangle_ids[t]);
    voxel.masks = masks.data();
    voxel.fine_masks = fine_masks_.data();
    voxel.fine_mask_count = static_cast<uint32_t>(fine_masks_.size());
    MarkSeeThrough(catalog().materials, voxel);
  }
}

void ResidentScene::Hide(const std::function<bool(uint32_t part)>& is_hidden) {
  hidden_.assign((store_->part_count() + 63) / 64, 0);
  for (uint32_t part = 0; part < store_->part_count(); ++part)
    if (is_hidden(part)) hidden_[part / 64] |= uint64_t{1} << part % 64;
  for (VoxelGeometry& voxel : views_[0]->voxels_) {
    voxel.hidden = hidden_.data();
    voxel.hidden_words = static_cast<uint32_t>(hidden_.size());
  }
}

const SceneView& ResidentScene::view(TreeLayout layout) {
  std::unique_ptr<SceneView>& made = views_[static_cast<size_t>(layout)];
  if (made) return *made;
  const Catalog& c = catalog();
  auto view = std::make_unique<SceneView>(SceneView{});
  view->voxels_ = views_[0]->voxels_;
  view->top_ = c.top_tree();
  const uint32_t levels = layout == TreeLayout::kBacktrack ? kBacktrackLevels : kRestartLevels;
  const auto lay_out = [&](const KdNode* nodes, uint32_t count, const Box& box, const KdNode*& laid) {
    const std::vector<KdNode> plain = test::FlattenTreelets({nodes, count});
    view->nodes_.push_back(layout == TreeLayout::kRopes ? MakeRopes(plain, box)
                                                        : LayOutTreelets(plain, levels, box));
    laid = view->nodes_.back().data();
  };
  for (size_t v = 0; v < view->voxels_.size(); ++v) {
    VoxelGeometry& g = view->voxels_[v];
    lay_out(g.nodes, g.node_count, CellOf(g.nodes), g.nodes);
  }
  lay_out(c.top_nodes.data(), static_cast<uint32_t>(c.top_nodes.size()),
          {c.meta.root_lower, c.meta.root_upper}, view->top_.nodes);
  view->top_node_slots_ = static_cast<uint32_t>(view->nodes_.back().size());
  made = std::move(view);
  return *made;
}

Suspensions TraceSuspending(const SceneView& view, std::span<const TraceFunction> traces,
                            std::vector<RayPacket>& packets, std::span<const uint64_t> wanted) {
  Granting granting{view, std::vector<bool>(view.voxels().size())};
  std::vector<uint64_t> active(packets.size(), ~uint64_t{0});
  std::ranges::copy(wanted, active.begin());
  std::vector<std::vector<uint32_t>> used(packets.size() *
                                          RayPacket::kRays);  // per ray: voxels that were resident
  uint64_t repeated = 0;
  for (uint32_t round = 0;; ++round) {
    traces[round % traces.size()](view.top(), {Granting::Find, &granting}, packets.data(), active.data(),
                                  static_cast<uint32_t>(packets.size()));
    granting.granted.assign(view.voxels().size(), false);
    bool any = false;
    for (size_t p = 0; p < packets.size(); ++p) {
      const uint64_t traced = std::exchange(active[p], 0);
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        const uint32_t voxel = packets[p].waits_for[i];
        if (voxel == kNoVoxel || (traced >> i & 1) == 0) continue;
        const auto& before = used[p * RayPacket::kRays + i];
        repeated += std::count(before.begin(), before.end(), voxel) != 0 ? 1 : 0;
        active[p] |= uint64_t{1} << i;
        if (!any || voxel % 3 == round % 3) granting.granted[voxel] = true;
        any = true;
      }
    }
    for (size_t p = 0; p < packets.size(); ++p)
      for (uint64_t left = active[p]; left != 0; left &= left - 1) {
        const auto i = static_cast<uint32_t>(std::countr_zero(left));
        const uint32_t voxel = packets[p].waits_for[i];
        if (granting.granted[voxel]) used[p * RayPacket::kRays + i].push_back(voxel);
      }
    // A ray that goes back and forth would never end.
    if (!any || repeated != 0) return {granting.refused, repeated};
  }
}

}  // namespace quarry::test
