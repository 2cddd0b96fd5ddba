#include "preprocess/ingest/scene_tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <limits>

#include "common/voxel/parts/part_attributes.h"
#include "preprocess/import/text/text_number.h"
#include "preprocess/spill/saved_tables.h"

namespace quarry {
namespace {

bool IsUsable(const NamedCamera& camera) { return IsSane(camera.spec); }
bool IsUsable(const NamedLight& light) { return IsSane(light); }

}  // namespace

void SceneTables::BeginFile(std::string_view name) {
  file_name_ = name;
  file_part_ = kNoIndex;
  file_parts_.clear();
}

uint32_t SceneTables::AddMaterial(const Material& material, double unit_length) {
  tables_.materials.push_back(material);
  float& depth = tables_.materials.back().transmission_depth;
  depth = static_cast<float>(std::min(depth * unit_length, double{std::numeric_limits<float>::max()}));
  return static_cast<uint32_t>(tables_.materials.size() - 1);
}

/// The part below which a new part goes, for the parent that an importer states.
uint32_t SceneTables::ParentFor(uint32_t parent) {
  if (parent == kNoIndex) return files_apart_ ? FileRoot() : ScenePart::kNoParent;
  uint32_t levels = 1;
  for (uint32_t above = parent; above != ScenePart::kNoParent; above = tables_.parts.facts[above].parent)
    ++levels;
  return levels > kMostPartLevels ? tables_.parts.facts[parent].parent : parent;
}

/// A part below `parent`, and whether it is new.
std::pair<SceneTables::PartsByName::iterator, bool> SceneTables::Add(PartsByName& parts,
                                                                     std::string_view name, uint32_t parent) {
  const auto next = static_cast<uint32_t>(tables_.parts.names.size());
  std::string key(reinterpret_cast<const char*>(&parent), sizeof parent);
  const auto found = parts.emplace(key.append(name), Named{next});
  if (found.second) {
    tables_.parts.names.emplace_back(name);
    tables_.parts.facts.emplace_back().parent = parent;
  }
  return found;
}

/// A new part, with a number behind its name if that is taken.
uint32_t SceneTables::AddApart(PartsByName& parts, std::string_view name, uint32_t parent) {
  const auto [first, is_new] = Add(parts, name, parent);
  if (is_new) return first->second.part;
  for (Named& named = first->second;;) {  // references stay valid when the table grows
    const auto [other, added] = Add(parts, fmt::format("{} #{}", name, ++named.number), parent);
    if (added) return other->second.part;
  }
}

uint32_t SceneTables::AddPart(std::string_view name, uint32_t parent) {
  return Add(file_parts_, name, ParentFor(parent)).first->second.part;
}

uint32_t SceneTables::AddSibling(std::string_view name, uint32_t parent) {
  return AddApart(file_parts_, name, ParentFor(parent));
}

void SceneTables::SetAttributes(uint32_t part, std::string json) {
  if (IsAttributes(json)) {
    tables_.parts.attributes.push_back({part, std::move(json)});
    return;
  }
  if (!warned_of_attributes_)
    Warn(fmt::format("{}: attributes of part {} are left out: they have more than {} bytes or {} levels",
                     file_name_, Quoted(tables_.parts.names[part]), kMostAttributeBytes,
                     kMostAttributeLevels));
  warned_of_attributes_ = true;
}

uint32_t SceneTables::FileRoot() {
  if (file_part_ == kNoIndex) file_part_ = AddApart(files_, file_name_, ScenePart::kNoParent);
  return file_part_;
}

uint32_t SceneTables::DefaultMaterial() {
  if (default_material_ == kNoIndex) default_material_ = AddMaterial(Material{"default"});
  return default_material_;
}

uint32_t SceneTables::FilePart() {
  if (files_apart_) return FileRoot();
  if (file_part_ == kNoIndex) file_part_ = AddPart(file_name_, kNoIndex);
  return file_part_;
}

template <class View>
void SceneTables::AddView(View view, size_t most, std::vector<View>& views) {
  const bool usable = IsUsable(view);
  if (!usable || views.size() >= most) {
    if (!warned_of_views_)
      Warn(fmt::format(
          "{}: {} is left out: {}", file_name_, view.name.empty() ? "a view" : view.name,
          usable ? fmt::format("a store holds {} of its kind", most) : "it holds invalid numbers"));
    warned_of_views_ = true;
    return;
  }
  const std::string name = view.name;
  const auto taken = [&] {
    return std::ranges::any_of(views, [&](const View& other) { return other.name == view.name; });
  };
  for (int number = 2; taken(); ++number) view.name = fmt::format("{} {}", name, number);
  views.push_back(std::move(view));
}

void SceneTables::AddCamera(NamedCamera camera, const SceneCoordinates& coordinates) {
  CameraSpec& spec = camera.spec;
  const glm::dvec3 forward = coordinates.Direction(spec.at - spec.eye);
  spec.eye = coordinates.Point(spec.eye);
  spec.at = spec.eye + forward;
  spec.up = coordinates.Direction(spec.up);
  spec.ortho_height *= coordinates.UnitLength();
  AddView(std::move(camera), kMaxSceneCameras, tables_.views.cameras);
}

void SceneTables::AddLight(NamedLight light, const SceneCoordinates& coordinates) {
  const double length = coordinates.UnitLength();
  if (light.kind == LightKind::kPoint) light.radiance *= static_cast<float>(length * length);
  light.position = coordinates.Point(light.position);
  light.direction = glm::vec3(glm::normalize(coordinates.Direction(glm::dvec3(light.direction))));
  for (glm::vec3& edge : light.edges) edge = glm::vec3(coordinates.Direction(glm::dvec3(edge) * length));
  AddView(std::move(light), kMaxLights, tables_.views.lights);
}

void SceneTables::Warn(std::string message) {
  warn_(message);
  tables_.warnings.push_back(std::move(message));
}

Status SceneTables::Finish() {
  file_parts_ = {};
  if (tables_.materials.empty()) DefaultMaterial();
  if (tables_.materials.size() > kMostMaterials)
    return Fail(fmt::format("{}: more than 65536 materials", file_name_));
  return {};
}

void SceneTables::Save(ByteWriter& out) const {
  PutMaterials(tables_.materials, out);
  PutTexts(tables_.parts.names, out);
  out.PutArray(tables_.parts.facts);
  out.Put(uint64_t{tables_.parts.attributes.size()});
  for (const StatedAttributes& stated : tables_.parts.attributes) {
    out.Put(stated.part);
    PutText(stated.json, out);
  }
  PutTexts(tables_.warnings, out);
  PutTexts(tables_.notes, out);
  PutViews(tables_.views, out);
}

void SceneTables::Restore(ByteReader& in) {
  tables_.materials = GetMaterials(in);
  tables_.parts.names = GetTexts(in);
  tables_.parts.facts = in.GetArray<ScenePart>(tables_.parts.names.size());
  for (auto left = in.Get<uint64_t>(); left > 0 && in.ok(); --left) {
    const auto part = in.Get<uint32_t>();
    tables_.parts.attributes.push_back({part, GetText(in)});
  }
  tables_.warnings = GetTexts(in);
  tables_.notes = GetTexts(in);
  tables_.views = GetViews(in);
}

}  // namespace quarry
