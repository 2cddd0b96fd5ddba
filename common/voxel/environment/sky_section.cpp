#include "common/voxel/environment/sky_section.h"

#include <memory>
#include <utility>

namespace quarry {

Status DecodeSky(std::span<const std::byte> bytes, Catalog& catalog) {
  const bool one = catalog.voxels.empty() && catalog.textures.size() == 1;
  const TexelLayout layout = one ? catalog.textures[0].layout : TexelLayout{};
  if (layout.format != TexelFormat::kHalf || layout.channels != 3 || layout.width != 2 * layout.height)
    return Fail("the ENVR section belongs to no image that can be an environment");
  QUARRY_ASSIGN(SkyTable table, SkyTable::Decode(bytes, layout.width));
  catalog.sky = std::make_shared<const SkyTable>(std::move(table));
  return {};
}

}  // namespace quarry
