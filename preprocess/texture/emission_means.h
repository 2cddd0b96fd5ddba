#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/file.h"
#include "common/base/status.h"
#include "common/scene/material.h"
#include "common/voxel/emitters/emitter.h"
#include "common/voxel/store_writer.h"

namespace quarry {

/// The mean radiance of triangles whose material has a map of emission, from the pages of a store that is
/// being written. Memory: kMostPages pages as floats, 8 MiB at most. Thread safety: none.
class EmissionMeans {
 public:
  /// `textures`: of the store. `file`: has their pages. Both outlive this.
  EmissionMeans(const std::vector<WrittenTexture>& textures, const InputFile& file)
      : textures_(textures), file_(file) {}

  /// The mean over 64 places of the triangle, in the level where these are about a texel apart. Errors: read
  /// errors; a page that is damaged.
  Result<glm::vec3> Of(const Emitter& emitter, const TextureBinding& map);

 private:
  static constexpr size_t kMostPages = 128;
  Result<const std::vector<float>*> PageAt(uint32_t texture, uint32_t page);

  const std::vector<WrittenTexture>& textures_;
  const InputFile& file_;
  std::map<uint32_t, TextureShape> shapes_;
  /// By texture and page: linear values, as ToLinear() gives them.
  std::map<std::pair<uint32_t, uint32_t>, std::vector<float>> pages_;
};

/// Gives the writer of a store its emitters with their radiance. Those with a map get its mean over the
/// triangle. Emitters whose mean is 0, or whose material shines no more, are left out. `materials`: of the
/// store. `path`: of the writer's file, which has all pages. Errors: as EmissionMeans; write errors.
Status GiveEmitters(std::vector<Emitter> emitters, const std::vector<Material>& materials,
                    const std::string& path, StoreWriter& writer);

}  // namespace quarry
