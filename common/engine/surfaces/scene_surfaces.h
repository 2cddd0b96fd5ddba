#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "common/engine/surfaces/texture_filter.h"
#include "common/scene/surface_properties.h"
#include "common/voxel/catalog.h"

// The textured materials of a scene, made ready for lookups.

namespace quarry {

/// Sets of uses of textures, a bit each.
using TextureUses = uint32_t;
constexpr TextureUses UseBit(TextureUse use) { return 1u << static_cast<uint32_t>(use); }
/// The uses that decide a surface's colour and normal; and all that decide these or its highlights.
inline constexpr TextureUses kUsesOfColor = UseBit(TextureUse::kDiffuse) | UseBit(TextureUse::kEmission) |
                                            UseBit(TextureUse::kNormal) | UseBit(TextureUse::kBump);
inline constexpr TextureUses kUsesOfHighlights =
    kUsesOfColor | UseBit(TextureUse::kSpecular) | UseBit(TextureUse::kMetalRoughness);

/// A material's use of a texture.
struct SurfaceTexture {
  TextureBinding binding;
  float size_lod;  ///< add to the level of detail of an image of one texel for that of this image
};

/// The values of textures at a point of a surface.
struct TextureValues {
  glm::vec3 base{0}, specular{0}, emission{0};
  float roughness = 0, metalness = 0;
};

/// The textured materials of a scene. Immutable, so thread-safe.
/// Memory: about 500 bytes a texture, 80 a use.
class SceneSurfaces {
 public:
  explicit SceneSurfaces(const Catalog& catalog);

  /// Whether any material has a texture.
  bool textured() const { return !textures_.empty(); }
  /// The uses of a material, a bit each.
  TextureUses UsesOf(uint32_t material) const { return materials_[material].uses; }
  /// The material's textures, by ascending use.
  std::span<const SurfaceTexture> TexturesOf(uint32_t material) const {
    const Entry& m = materials_[material];
    return {textures_.data() + m.first, m.count};
  }
  /// The material's map of opacity, or of emission; null: it has none.
  const SurfaceTexture* OpacityOf(uint32_t material) const { return MapOf(material, TextureUse::kOpacity); }
  const SurfaceTexture* EmissionMapOf(uint32_t material) const {
    return MapOf(material, TextureUse::kEmission);
  }
  /// The texture that tints light on its way through the material; null: it has none.
  const SurfaceTexture* TintOf(uint32_t material) const {
    return materials_[material].tints ? MapOf(material, TextureUse::kDiffuse) : nullptr;
  }
  /// Whether a texture changes the material's panes in a way that light rays do not look up.
  bool HidesPanes(uint32_t material) const { return materials_[material].hides_panes; }
  /// Whether TintOf() any material is a texture.
  bool tints_light() const { return tints_light_; }
  const TexturePyramid& pyramid(const SurfaceTexture& texture) const {
    return pyramids_[texture.binding.texture];
  }
  /// The material's properties where its textures `uses` have the values `values`. These replace values of
  /// the form that the other form was derived from. Of OpenPBR's parameters the base colour
  /// and the highlight follow the weights.
  SurfaceProperties PropertiesAt(const Material& material, uint32_t number, TextureUses uses,
                                 const TextureValues& values) const;

 private:
  struct Entry {
    uint32_t first = 0, count = 0;
    TextureUses uses = 0;
    bool open_pbr = false;
    bool tints = false;  ///< whether its texture of base colour tints light that passes
    bool hides_panes = false;
    bool tint_is_base = false;  ///< whether the transmitted colour is the base colour, as in glTF
    glm::vec3 sent_on{0};       ///< share of mirror and glass in DeriveOpenPbr()'s base colour
  };
  const SurfaceTexture* MapOf(uint32_t material, TextureUse use) const {
    for (const SurfaceTexture& texture : TexturesOf(material))
      if (texture.binding.use == use) return &texture;
    return nullptr;
  }
  std::vector<TexturePyramid> pyramids_;
  std::vector<SurfaceTexture> textures_;
  std::vector<Entry> materials_;
  bool tints_light_ = false;
};

}  // namespace quarry
