#pragma once

#include <cstdint>

#include "common/engine/packet_work.h"
#include "common/scene/ray_query.h"

namespace quarry {

/// Decides how a sample goes on once its ray has hit something. Each mode of rendering is a class, and so is
/// each question that needs no picture. All functions take lanes of one packet and move them to their next
/// stages; there is one call a packet and stage, with lanes that are not empty. Immutable, so thread-safe.
/// Source: Purcell et al. 2002, section 3: new rays carry their weight; no recursion.
class Integrator {
 public:
  virtual ~Integrator() = default;

  struct Needs {
    /// Whether surfaces of hits are made; else a hit alone is enough.
    bool surfaces = true;
    /// Whether surfaces have the normals, uv and colours of their vertices.
    bool attributes = true;
    /// Whether samples belong to pixels, and have light. Requires: false without surfaces.
    bool pixels = true;
    /// Whether the first ray of a sample may end at any hit.
    bool any_hit = false;
    HitRule hits;               ///< of all its rays
    TextureUses uses = 0;       ///< uses of textures that its shading needs
    uint32_t pending_rays = 0;  ///< limit of rays that a sample has waiting in PendingRays
    bool paths = false;         ///< whether samples have a PathPacket
    /// Whether lanes whose samples have ended take the next samples at once, not all lanes of a packet
    /// together: for samples of very different length.
    bool refills = false;
  };
  virtual Needs needs() const = 0;

  /// The samples of `lanes` begin.
  virtual void Begin(PacketWork& /*work*/, uint64_t /*lanes*/) const {}
  /// The rays of `lanes` to their nearest hits have left the scene. Returns: the lanes that wait for their
  /// sky, at kLight; the samples of the others go on at kNext. Requires: samples belong to pixels.
  virtual uint64_t Missed(PacketWork& work, uint64_t lanes) const;
  /// kShade: the surfaces are complete; without them, the hits are found. Adds the light that needs no ray.
  virtual void Shade(PacketWork& work, uint64_t lanes) const = 0;
  /// kLight: sends the next light ray of each sample, or none. Returns: the lanes that wait for a block.
  virtual uint64_t SendLightRays(PacketWork& work, uint64_t lanes) const;
  /// kShadow: the light rays have been traced to any opaque hit.
  virtual void Shadowed(PacketWork& work, uint64_t lanes) const;
  /// kPass: the light rays, traced again to their nearest hits, have hit nothing more.
  virtual void Passed(PacketWork& work, uint64_t lanes) const;
  /// kTint: the light rays have met something see-through. Returns: the lanes that wait for a block.
  virtual uint64_t Tint(PacketWork& work, uint64_t lanes) const;
  /// kBounce: all light has come; puts the rays that go on into the list of pending rays.
  virtual void Bounce(PacketWork& work, uint64_t lanes) const;
};

/// Adds radiance to the pixels of `lanes`, by the weights of their paths.
void AddLight(PacketWork& work, uint64_t lanes, const Vectors& radiance);

/// The scattering properties of `lanes`, in the scratch memory. Requires: always the same `albedo`.
const ScatterPacket& ScatterOfSurfaces(PacketWork& work, uint64_t lanes, AlbedoOf albedo);

}  // namespace quarry
