#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "preprocess/import/model_sink.h"

namespace quarry {

/// A sink that ignores a model; subclasses take the parts they want.
class IgnoringSink : public ModelSink {
 public:
  Status BeginFile(std::string_view) override { return {}; }
  Status EndFile() override { return {}; }
  uint32_t AddMaterial(const Material&) override { return materials_++; }
  uint32_t AddPart(std::string_view, uint32_t) override { return parts_++; }
  uint32_t AddSibling(std::string_view, uint32_t) override { return parts_++; }
  bool takes_textures() const override { return false; }
  Result<uint32_t> AddTexture(TextureImage) override { return kNoIndex; }
  Status AddPosition(const glm::dvec3&, const Rgba8&) override { return {}; }
  Status AddNormal(const glm::vec3&) override { return {}; }
  Status AddUv(const glm::vec2&) override { return {}; }
  Status AddPolygon(std::span<const Corner>, uint32_t, uint32_t) override { return {}; }
  void Warn(std::string) override {}

 private:
  uint32_t materials_ = 0, parts_ = 0;
};

}  // namespace quarry
