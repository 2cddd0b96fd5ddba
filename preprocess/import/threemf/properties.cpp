#include "preprocess/import/threemf/properties.h"

#include <fmt/format.h>

#include <cstring>

#include "common/scene/open_pbr.h"
#include "preprocess/import/file_color.h"

namespace quarry {
namespace {

Material ToMaterial(const std::string& name, const Rgba8& color) {
  Material m;
  m.name = name;
  const float opacity = static_cast<float>(color.a) / 255;
  const uint8_t channels[3] = {color.r, color.g, color.b};
  for (int a = 0; a < 3; ++a) m.diffuse[a] = static_cast<float>(DecodeSrgb(channels[a] / 255.0)) * opacity;
  m.transmittance = glm::vec3(1 - opacity);
  DeriveOpenPbr(m);
  return m;
}

}  // namespace

bool ParseThreeMfColor(const char* text, Rgba8& color) {
  const size_t length = std::strlen(text);
  if ((length != 7 && length != 9) || text[0] != '#') return false;
  uint32_t value = 0;
  for (size_t i = 1; i < length; ++i) {
    const char c = text[i];
    const bool digit = c >= '0' && c <= '9', small = c >= 'a' && c <= 'f', capital = c >= 'A' && c <= 'F';
    if (!digit && !small && !capital) return false;
    value = value << 4 | static_cast<uint32_t>(digit ? c - '0' : small ? c - 'a' + 10 : c - 'A' + 10);
  }
  if (length == 7) value = value << 8 | 0xFF;
  color = {static_cast<uint8_t>(value >> 24), static_cast<uint8_t>(value >> 16),
           static_cast<uint8_t>(value >> 8), static_cast<uint8_t>(value)};
  return true;
}

Status ThreeMfProperties::BeginGroup(uint32_t part, uint32_t id, Kind kind) {
  if (groups_.size() >= kMostGroups)
    return Fail(fmt::format("has more than {} groups of materials or colours", kMostGroups));
  const auto [at, is_new] = groups_.try_emplace({part, id});
  if (!is_new) return Fail(fmt::format("a second resource has the id {}", id));
  group_ = &at->second;
  *group_ = {kind, static_cast<uint32_t>(kind == Kind::kMaterials ? bases_.size() : colors_.size()), 0};
  return {};
}

Status ThreeMfProperties::AddMaterial(std::string name, const Rgba8& color) {
  if (group_->kind != Kind::kMaterials) return {};
  if (bases_.size() >= kMostMaterials) return Fail(fmt::format("has more than {} materials", kMostMaterials));
  bases_.push_back({std::move(name), color});
  ++group_->count;
  return {};
}

Status ThreeMfProperties::AddColor(const Rgba8& color) {
  if (group_->kind != Kind::kColors) return {};
  if (colors_.size() >= kMostColors)
    return Fail(fmt::format("has more than {} colours; write it with fewer", kMostColors));
  colors_.push_back(FileColor(color.r, color.g, color.b, color.a));
  ++group_->count;
  return {};
}

void ThreeMfProperties::GiveTo(ModelSink& sink) {
  materials_.clear();
  for (const Base& base : bases_) materials_.push_back(sink.AddMaterial(ToMaterial(base.name, base.color)));
}

bool ThreeMfProperties::Find(uint32_t part, uint32_t id, uint32_t index, Look& look) const {
  const auto at = groups_.find({part, id});
  if (at == groups_.end() || index >= at->second.count) return false;
  const Group& group = at->second;
  if (group.kind == Kind::kMaterials) look = {materials_[group.first + index], false, {}};
  if (group.kind == Kind::kColors) look = {kNoIndex, true, colors_[group.first + index]};
  return group.kind != Kind::kLeftOut;
}

}  // namespace quarry
