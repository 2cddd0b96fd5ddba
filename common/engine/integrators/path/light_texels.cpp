#include "common/engine/integrators/path/light_texels.h"

#include <cstddef>

#include "common/engine/integrators/path/path_packet.h"
#include "common/engine/rays/lanes.h"
#include "common/math/random.h"

namespace quarry {
namespace {

constexpr uint32_t kTexelDimension = 0xC09u << 20;  // no sampling uses it

/// A texel of an emitter's map, one of the four around the place as often as bilinear interpolation weighs
/// it.
struct MapTexel {
  const SurfaceTexture& texture;
  const TexturePyramid& pyramid;
  TexelPlace place;
};
MapTexel TexelOfMap(const PacketWork& work, uint32_t lane, const PathLights& lights) {
  const PathPacket& path = *work.path;
  const PathLights::MapPlace at =
      lights.PlaceInMap(path.texel[lane], path.numbers.At(PathNumbers::kLightPlace, lane));
  const SurfaceTexture& texture = *work.view.surfaces->EmissionMapOf(at.material);
  const TexturePyramid& pyramid = work.view.surfaces->pyramid(texture);
  const BilinearTexels texels = BaseFootprint(pyramid, texture.binding, at.uv.x, at.uv.y).levels[0];
  const glm::vec2 aside = AsideOfTexel(work, lane);
  const uint32_t x = texels.x[aside.x < texels.fx ? 1 : 0], y = texels.y[aside.y < texels.fy ? 1 : 0];
  return {texture, pyramid, PlaceOf(pyramid, 0, x, y)};
}

}  // namespace

glm::vec2 AsideOfTexel(const PacketWork& work, uint32_t lane) {
  const SamplePacket& s = work.samples;
  const RandomKey key{work.view.view.seed, s.image_pixel[lane], s.sample[lane], s.path_code[lane]};
  return {static_cast<float>(RandomBits(key, kTexelDimension) >> 8) * 0x1p-24f,
          static_cast<float>(RandomBits(key, kTexelDimension + 1) >> 8) * 0x1p-24f};
}

uint64_t LookUpLights(PacketWork& work, uint64_t lanes, const PathLights& lights) {
  PathPacket& path = *work.path;
  BlockKey page;
  const ResidentBlock* block = nullptr;
  uint64_t waiting = 0;
  const auto is_there = [&](uint32_t lane, BlockKey key) {
    if (!block || key != page) block = work.Find(page = key);
    if (block) return true;
    work.Park(lane, key);
    waiting |= uint64_t{1} << lane;
    return false;
  };
  const auto add = [&](uint32_t lane, const glm::vec3& radiance) {
    const auto i = static_cast<int>(lane);
    path.radiance.Set(i, path.radiance[i] + work.samples.light[i] * radiance);
  };
  ForEachLane(lanes & ~path.of_map, [&](uint32_t lane) {
    const EnvironmentLight::Place place = lights.environment()->PlaceOf(path.texel[lane]);
    if (is_there(lane, place.page))
      add(lane, lights.environment()->RadianceAt(block->bytes.bytes(), place.index));
  });
  ForEachLane(lanes & path.of_map, [&](uint32_t lane) {
    const MapTexel texel = TexelOfMap(work, lane, lights);
    if (!is_there(lane, texel.place.page)) return;
    const std::byte* bytes = block->bytes.bytes().data();
    add(lane, EmissionOf(texel.texture, TexelAt(texel.pyramid.layout, bytes, texel.place.index)));
  });
  return waiting;
}

}  // namespace quarry
