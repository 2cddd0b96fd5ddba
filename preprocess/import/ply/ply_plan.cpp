#include "preprocess/import/ply/ply_plan.h"

#include <algorithm>
#include <span>
#include <string_view>

namespace quarry {
namespace {

struct SlotName {
  std::string_view name;
  uint8_t slot;
};

constexpr SlotName kVertexSlots[] = {
    {"x", kX},         {"y", kY},         {"z", kZ},         {"nx", kNx},      {"ny", kNy},
    {"nz", kNz},       {"s", kU},         {"t", kV},         {"u", kU},        {"v", kV},
    {"texture_u", kU}, {"texture_v", kV}, {"texture_s", kU}, {"texture_t", kV}};
constexpr SlotName kFaceSlots[] = {
    {"material_index", kMaterial}, {"part_index", kPart}, {"texnumber", kTextureNumber}};
/// Names of red, green, blue and alpha, of vertices and of faces.
constexpr std::string_view kColorNames[][4] = {
    {"red", "green", "blue", "alpha"},
    {"r", "g", "b", "a"},
    {"diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"}};

/// The factor that brings a channel of `type` to 0..255.
double ColorScale(PlyType type) {
  if (IsReal(type)) return kScaleOfReal;
  return type == PlyType::kUint16 ? 255.0 / 65535.0 : 1.0;
}

bool IsIndexList(const PlyProperty& property) {
  return property.count_type && !IsReal(property.type) &&
         (property.name == "vertex_indices" || property.name == "vertex_index");
}

bool IsUvList(const PlyProperty& property) {
  return property.count_type && IsReal(property.type) && property.name == "texcoord";
}

PlyPlan MakePlan(const PlyElement& element, std::span<const SlotName> slots, bool wants_indices) {
  PlyPlan plan;
  for (const PlyProperty& property : element.properties) {
    PlyStep step{property.type, property.count_type};
    if (wants_indices && IsIndexList(property)) {
      step.target = PlyStep::kIndexList;
      plan.has_index_list = true;
    } else if (wants_indices && IsUvList(property)) {
      step.target = PlyStep::kUvList;
      plan.has_uv_list = true;
    } else if (!property.count_type) {
      for (const SlotName& slot : slots)
        if (slot.name == property.name) step.target = slot.slot;
      for (const auto& names : kColorNames)
        for (uint8_t i = 0; i < 4; ++i)
          if (names[i] == property.name) step.target = static_cast<uint8_t>(kRed + i);
    }
    if (step.target < PlyRow::kMaxValues) plan.filled |= 1u << step.target;
    plan.has_lists |= property.count_type.has_value();
    if (step.target >= kRed && step.target <= kAlpha)
      plan.color_scale[step.target - kRed] = ColorScale(step.type);
    plan.steps.push_back(step);
  }
  return plan;
}

}  // namespace

PlyPlan PlanVertex(const PlyElement& element) { return MakePlan(element, kVertexSlots, false); }

PlyPlan PlanFace(const PlyElement& element) {
  PlyPlan plan = MakePlan(element, kFaceSlots, true);
  if (plan.steps.empty() || plan.steps[0].target != PlyStep::kIndexList) return plan;
  if (SizeOf(*plan.steps[0].count_type) != 1 || SizeOf(plan.steps[0].type) != 4) return plan;
  uint32_t bytes = 1 + 3 * 4;
  for (size_t i = 1; i < plan.steps.size(); ++i) {
    if (plan.steps[i].count_type) return plan;
    bytes += SizeOf(plan.steps[i].type);
  }
  plan.triangle_bytes = bytes;
  return plan;
}

PlyPlan PlanToSkip(const PlyElement& element) {
  PlyPlan plan;
  for (const PlyProperty& property : element.properties) {
    plan.steps.push_back({property.type, property.count_type});
    plan.has_lists |= property.count_type.has_value();
  }
  return plan;
}

}  // namespace quarry
