#pragma once

#include <cstdint>

#include "common/engine/packet_work.h"
#include "common/scene/surface_properties.h"

namespace quarry {

/// Calls body(const SurfaceProperties&, lanes) until all of `lanes` have had their surfaces' properties.
/// Lanes of a material are called for together, but lanes with textures one by one. Requires: the surfaces
/// are complete.
template <class Body>
void ForEachProperties(const PacketWork& work, uint64_t lanes, Body&& body) {
  // A coloured part is plain and matt; the surface has the colour.
  if (const uint64_t colored = lanes & work.samples.colored) {
    Material plain;
    plain.diffuse = plain.base_color = glm::vec3(1);
    body(SurfaceProperties(plain), colored);
    lanes &= ~colored;
  }
  const SceneSurfaces& scene = *work.view.surfaces;
  const auto& materials = work.view.catalog.materials;
  const uint64_t looked_up = lanes & work.looked_up();
  ForEachMaterial(work.samples.surface, lanes & ~looked_up, [&](uint32_t material, uint64_t same) {
    body(SurfaceProperties(materials[material]), same);
  });
  ForEachLane(looked_up, [&](uint32_t i) {
    const uint32_t material = work.samples.surface.material[i];
    const TextureUses uses = scene.UsesOf(material) & work.view.texture_uses;
    body(scene.PropertiesAt(materials[material], material, uses, work.lookups->ValuesOf(static_cast<int>(i))),
         uint64_t{1} << i);
  });
}

}  // namespace quarry
