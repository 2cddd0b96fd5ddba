#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/base/status.h"
#include "common/scene/scene_views.h"
#include "common/voxel/catalog.h"
#include "common/voxel/texture_sections.h"
#include "common/voxel/voxel_block.h"

namespace quarry {

/// A voxel ready to be stored: compressed blocks and what the directory says of them.
struct EncodedVoxel {
  Bytes hot, shading;  ///< stored bytes; shading may be empty
  uint32_t hot_decoded = 0, shading_decoded = 0;
  uint64_t hot_logical = 0, shading_logical = 0;  ///< checksums of the streams, for the scene id
  uint32_t triangles = 0;
  glm::vec3 bounds_lower{0}, bounds_upper{0};  ///< of the triangles
  bool chained = false;                        ///< the next voxel written belongs to the same top-level leaf
};

/// Encodes and compresses a voxel; `shading` null where there is none. Thread-safe.
EncodedVoxel EncodeVoxel(const HotVoxel& hot, const ShadingVoxel* shading);

/// A page ready to be stored.
struct EncodedPage {
  Bytes stored;
  uint32_t decoded = 0;  ///< bytes of its texels
  uint64_t logical = 0;  ///< checksum of the streams
};

/// Encodes and compresses a page, see EncodePage. Thread-safe.
EncodedPage EncodeTexturePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                              std::span<const std::byte> texels);

/// A texture as it is written: with the checksums of its pages' streams, for the scene id.
struct WrittenTexture {
  Texture texture;
  std::vector<uint64_t> logical;
};

/// What a StoreWriter has of its voxels and textures beside the file, and goes on from.
struct StoreProgress {
  uint64_t bytes = 0;  ///< of the file; 0: none yet
  std::vector<VoxelEntry> directory;
  std::vector<uint64_t> logical;  ///< checksums of streams, two a voxel
  std::vector<WrittenTexture> textures;
};

/// Writes a scene store: voxels as they come, then textures, then the rest. Nothing is at `path` before
/// Finish succeeds. Not thread-safe.
class StoreWriter {
 public:
  static Result<StoreWriter> Create(const std::string& path);
  /// One whose file lies at `temporary` until it is finished, and outlives the process; `progress` is what an
  /// earlier one had when it was last synchronised.
  static Result<StoreWriter> Continue(const std::string& path, const std::string& temporary,
                                      StoreProgress progress);

  /// Appends voxel number voxel_count().
  Status AddVoxel(const EncodedVoxel& voxel);
  uint32_t voxel_count() const { return static_cast<uint32_t>(directory_.size()); }

  /// After the last voxel: begins a texture, whose pages then come in any order, each once. Requires: a
  /// layout that CheckTexelLayout takes.
  void BeginTexture(std::string name, const TexelLayout& layout);
  Status AddPage(uint32_t page, const EncodedPage& encoded);
  /// Takes back the texture begun last, should it turn out that it cannot be finished.
  Status DropTexture();
  const std::vector<WrittenTexture>& textures() const { return textures_; }

  /// Writes all other sections and gives the store its name. The sizes and LZ4 version in `meta` are filled
  /// in.
  Result<SceneId> Finish(SceneMeta meta, const std::vector<KdNode>& top_nodes,
                         const std::vector<Material>& materials, const std::vector<std::string>& parts,
                         const SceneViews& views = {});
  uint64_t bytes_written() const { return file_.size(); }
  /// Makes the voxels and textures so far outlast a loss of power.
  Status Sync() { return file_.Sync(); }
  const std::vector<VoxelEntry>& directory() const { return directory_; }
  const std::vector<uint64_t>& logical() const { return logical_; }

 private:
  explicit StoreWriter(OutputFile file) : file_(std::move(file)) {}
  OutputFile file_;
  std::vector<VoxelEntry> directory_;
  std::vector<uint64_t> logical_;  ///< checksums of streams, two a voxel
  std::vector<WrittenTexture> textures_;
  uint64_t texture_begin_ = 0;  ///< bytes of the file when the last texture was begun
};

}  // namespace quarry
