#include "master/part_selections.h"

#include <algorithm>
#include <glm/common.hpp>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace quarry {
namespace {

/// The bits of parts that no list shows.
Result<PartBits> HiddenBy(const PartTree& parts, const PartLists& lists) {
  PartBits hidden = NoParts(parts.size());
  if (lists.only) {
    QUARRY_ASSIGN(const PartBits shown, parts.Resolve(*lists.only));
    for (size_t i = 0; i < hidden.size(); ++i) hidden[i] = ~shown[i];
    // Parts of the last word that do not exist stay unset: equal selections have equal bits.
    if (parts.size() % 64 != 0) hidden.back() &= (uint64_t{1} << parts.size() % 64) - 1;
  }
  if (lists.hide.empty()) return hidden;
  QUARRY_ASSIGN(const PartBits more, parts.Resolve(lists.hide));
  for (size_t i = 0; i < hidden.size(); ++i) hidden[i] |= more[i];
  return hidden;
}

Status SetColors(const PartTree& parts, const PartLists& lists, PartSelection& selection) {
  if (lists.colors.empty()) return {};
  selection.color_of.resize(parts.size());
  for (const PartLists::Coloring& coloring : lists.colors) {
    QUARRY_ASSIGN(const PartBits bits, parts.Resolve(coloring.parts));
    uint16_t number = 0;
    if (coloring.color) {
      selection.colors.push_back(*coloring.color);
      number = static_cast<uint16_t>(selection.colors.size());
    }
    for (uint32_t part = 0; part < parts.size(); ++part)
      if (HasPart(bits, part)) selection.color_of[part] = number;
  }
  return {};
}

/// Finds the voxels that hold hidden parts, alone or beside others.
Status SetVoxels(const StoreReader& store, PartSelection& selection) {
  using Shown = PartSelection::Shown;
  // A store from before does not say which parts a voxel has: it may have any.
  selection.voxels.assign(store.catalog().voxels.size(), Shown::kSome);
  if (!store.has_parts_of_voxels()) return {};
  return store.ForEachVoxelParts([&](uint32_t voxel, std::span<const uint32_t> parts) {
    const auto hidden =
        std::ranges::count_if(parts, [&](uint32_t part) { return HasPart(selection.hidden, part); });
    selection.voxels[voxel] = hidden == 0                   ? Shown::kAll
                              : hidden == std::ssize(parts) ? Shown::kNone
                                                            : Shown::kSome;
  });
}

}  // namespace

Result<std::shared_ptr<const PartTree>> PartSelections::Parts() {
  if (!parts_) {
    QUARRY_ASSIGN(parts_, PartTree::Read(store_));
  }
  return parts_;
}

Result<std::string> PartSelections::AttributesOf(uint32_t part) {
  if (!attributes_) {
    QUARRY_ASSIGN(attributes_, store_.part_sections().ReadAttributes());
  }
  return attributes_->Of(part);
}

Result<std::shared_ptr<const PartSelection>> PartSelections::Resolve(const PartLists* lists, bool caps) {
  QUARRY_ASSIGN(const auto tree, Parts());
  const PartTree& parts = *tree;
  auto selection = std::make_shared<PartSelection>();
  if (lists) {
    QUARRY_ASSIGN(selection->hidden, HiddenBy(parts, *lists));
    QUARRY_TRY(SetColors(parts, *lists, *selection));
  }
  if (std::ranges::all_of(selection->hidden, [](uint64_t bits) { return bits == 0; }))
    selection->hidden.clear();
  if (selection->hides()) QUARRY_TRY(SetVoxels(store_, *selection));
  if (caps) {
    selection->closed = selection->inverted = NoParts(parts.size());
    for (uint32_t part = 0; part < parts.size(); ++part) {
      if ((parts[part].flags & PartTree::Part::kClosed) != 0) AddPart(selection->closed, part);
      if ((parts[part].flags & PartTree::Part::kInsideOut) != 0) AddPart(selection->inverted, part);
    }
  }
  selection->id = IdOf(*selection);
  return selection;
}

Status PartSelections::Complete(View& view) {
  const bool caps = !view.section.empty() && view.section.caps;
  const auto& lists = view.parts.lists;
  view.parts.selection = nullptr;
  if (!lists && !caps) return {};
  const auto same = [&](const Kept& kept) {
    if (kept.caps != caps || (kept.lists == nullptr) != (lists == nullptr)) return false;
    return kept.lists == lists || *kept.lists == *lists;
  };
  if (const auto kept = std::ranges::find_if(kept_, same); kept != kept_.end()) {
    view.parts.selection = kept->selection;
    std::rotate(kept_.begin(), kept, kept + 1);
    return {};
  }
  QUARRY_ASSIGN(view.parts.selection, Resolve(lists.get(), caps));
  kept_.push_front({lists, caps, view.parts.selection});
  if (kept_.size() > kMostKept) kept_.pop_back();
  return {};
}

std::shared_ptr<const PartLists> PartSelections::Find(uint64_t id) const {
  for (const Kept& kept : kept_)
    if (kept.selection->id == id && !kept.caps) return kept.lists;
  return nullptr;
}

Result<PartSelections::Extent> PartSelections::ExtentOf(const PartSelection* selection) {
  QUARRY_ASSIGN(const auto parts, Parts());
  constexpr float kMost = std::numeric_limits<float>::infinity();
  Extent extent{glm::vec3(kMost), glm::vec3(-kMost)};
  for (uint32_t part = 0; part < parts->size(); ++part) {
    const PartTree::Part& p = (*parts)[part];
    if (selection && HasPart(selection->hidden, part)) {
      ++extent.hidden;
      continue;
    }
    extent.lower = glm::min(extent.lower, p.lower);
    extent.upper = glm::max(extent.upper, p.upper);
  }
  const SceneMeta& meta = store_.catalog().meta;
  if (!parts->has_tree()) extent.lower = meta.bounds_lower, extent.upper = meta.bounds_upper;
  return extent;
}

}  // namespace quarry
