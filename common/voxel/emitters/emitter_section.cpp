#include "common/voxel/emitters/emitter_section.h"

#include <glm/common.hpp>

namespace quarry {
namespace {

bool Within(const glm::vec3& p, const SceneMeta& meta) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(p[axis] >= meta.bounds_lower[axis] && p[axis] <= meta.bounds_upper[axis])) return false;
  return true;
}

}  // namespace

Bytes EncodeEmitters(std::span<const Emitter> emitters) {
  ByteWriter out;
  for (const Emitter& emitter : emitters) {
    out.Put(emitter.triangle);
    out.Put(emitter.part);
    out.Put(emitter.material);
    for (const glm::vec3& corner : emitter.corners) out.PutVec3(corner);
  }
  return out.Take();
}

Result<std::vector<Emitter>> DecodeEmitters(std::span<const std::byte> bytes, const Catalog& catalog) {
  if (bytes.size() % kEmitterBytes != 0 || bytes.size() / kEmitterBytes > kMostEmitters)
    return Fail("the EMIT section has a wrong size");
  std::vector<Emitter> emitters;
  ByteReader in(bytes);
  while (in.remaining() > 0) {
    Emitter emitter;
    emitter.triangle = in.Get<uint32_t>();
    emitter.part = in.Get<uint32_t>();
    emitter.material = in.Get<uint32_t>();
    for (glm::vec3& corner : emitter.corners) {
      corner = in.GetVec3<glm::vec3>();
      if (!Within(corner, catalog.meta)) return Fail("the EMIT section has a corner outside of the scene");
    }
    if (emitter.triangle >= catalog.meta.input_triangles ||
        (!emitters.empty() && emitter.triangle <= emitters.back().triangle))
      return Fail("the EMIT section has a triangle out of order");
    if (emitter.material >= catalog.materials.size() || !Shines(catalog.materials[emitter.material]))
      return Fail("the EMIT section names a material that does not shine");
    if (!(AreaOf(emitter) > 0)) return Fail("the EMIT section has a triangle without area");
    emitters.push_back(emitter);
  }
  return emitters;
}

}  // namespace quarry
