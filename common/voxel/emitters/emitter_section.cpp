#include "common/voxel/emitters/emitter_section.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <iterator>

namespace quarry {
namespace {

bool Within(const glm::vec3& p, const SceneMeta& meta) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(p[axis] >= meta.bounds_lower[axis] && p[axis] <= meta.bounds_upper[axis])) return false;
  return true;
}

bool IsRadiance(const glm::vec3& radiance) {
  for (int c = 0; c < 3; ++c)
    if (!(radiance[c] >= 0) || !std::isfinite(radiance[c])) return false;
  return radiance != glm::vec3(0);
}

void Put(const Emitter& emitter, bool is_mapped, ByteWriter& out) {
  out.Put(emitter.triangle);
  out.Put(emitter.part);
  out.Put(emitter.material);
  for (const glm::vec3& corner : emitter.corners) out.PutVec3(corner);
  if (!is_mapped) return;
  for (const glm::vec2& uv : emitter.uvs) {
    out.Put(uv.x);
    out.Put(uv.y);
  }
  out.PutVec3(emitter.radiance);
}

/// The emitters of one section, whose name is `name`.
Result<std::vector<Emitter>> DecodeSection(std::span<const std::byte> bytes, bool is_mapped, const char* name,
                                           const Catalog& catalog) {
  const auto fail = [&](const char* what) { return Fail(fmt::format("the {} section {}", name, what)); };
  const size_t size = is_mapped ? kMappedEmitterBytes : kEmitterBytes;
  if (bytes.size() % size != 0 || bytes.size() / size > kMostEmitters) return fail("has a wrong size");
  std::vector<Emitter> emitters;
  ByteReader in(bytes);
  while (in.remaining() > 0) {
    Emitter emitter;
    emitter.triangle = in.Get<uint32_t>();
    emitter.part = in.Get<uint32_t>();
    emitter.material = in.Get<uint32_t>();
    for (glm::vec3& corner : emitter.corners) {
      corner = in.GetVec3<glm::vec3>();
      if (!Within(corner, catalog.meta)) return fail("has a corner outside of the scene");
    }
    if (emitter.triangle >= catalog.meta.input_triangles ||
        (!emitters.empty() && emitter.triangle <= emitters.back().triangle))
      return fail("has a triangle out of order");
    if (emitter.material >= catalog.materials.size() || !Shines(catalog.materials[emitter.material]))
      return fail("names a material that does not shine");
    const Material& material = catalog.materials[emitter.material];
    if ((EmissionMapOf(material) != nullptr) != is_mapped)
      return fail(is_mapped ? "names a material without a map" : "names a material with a map");
    if (!(AreaOf(emitter) > 0)) return fail("has a triangle without area");
    emitter.radiance = material.emission;
    if (is_mapped) {
      for (glm::vec2& uv : emitter.uvs) {
        uv.x = in.Get<float>();
        uv.y = in.Get<float>();
        if (!std::isfinite(uv.x) || !std::isfinite(uv.y)) return fail("has a place that is not finite");
      }
      emitter.radiance = in.GetVec3<glm::vec3>();
      if (!IsRadiance(emitter.radiance)) return fail("has a radiance that is none");
    }
    emitters.push_back(emitter);
  }
  return emitters;
}

}  // namespace

EmitterSections EncodeEmitters(std::span<const Emitter> emitters, const std::vector<Material>& materials) {
  ByteWriter plain, mapped;
  for (const Emitter& emitter : emitters) {
    const bool is_mapped = EmissionMapOf(materials[emitter.material]) != nullptr;
    Put(emitter, is_mapped, is_mapped ? mapped : plain);
  }
  return {plain.Take(), mapped.Take()};
}

Result<std::vector<Emitter>> DecodeEmitters(std::span<const std::byte> plain,
                                            std::span<const std::byte> mapped, const Catalog& catalog) {
  QUARRY_ASSIGN(const std::vector<Emitter> of_plain, DecodeSection(plain, false, "EMIT", catalog));
  QUARRY_ASSIGN(const std::vector<Emitter> of_mapped, DecodeSection(mapped, true, "EMAP", catalog));
  if (of_plain.size() + of_mapped.size() > kMostEmitters)
    return Fail("the EMIT and EMAP sections have too many triangles");
  std::vector<Emitter> all;
  all.reserve(of_plain.size() + of_mapped.size());
  std::ranges::merge(of_plain, of_mapped, std::back_inserter(all), {}, &Emitter::triangle,
                     &Emitter::triangle);
  if (std::ranges::adjacent_find(all, {}, &Emitter::triangle) != all.end())
    return Fail("the EMIT and EMAP sections have a triangle twice");
  return all;
}

}  // namespace quarry
