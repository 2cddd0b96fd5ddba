#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/file.h"
#include "common/base/status.h"
#include "common/scene/scene_views.h"
#include "common/voxel/catalog.h"
#include "common/voxel/parts/part_sections.h"
#include "common/voxel/store_header.h"
#include "common/voxel/texture_sections.h"
#include "common/voxel/voxel_block.h"

namespace quarry {

/// A voxel ready to be stored: its compressed blocks and its directory entry. Units: sizes in bytes.
struct EncodedVoxel {
  Bytes hot, shading;  ///< stored bytes; `shading` may be empty
  uint32_t hot_decoded = 0, shading_decoded = 0;
  uint64_t hot_logical = 0, shading_logical = 0;  ///< checksums of the streams, for the scene id
  uint32_t triangles = 0;
  glm::vec3 bounds_lower{0}, bounds_upper{0};  ///< box of the triangles
  bool chained = false;                        ///< the next voxel written is in the same top-level leaf
  bool masks = false;                          ///< the hot block has opacity masks
  bool colored = false;                        ///< a vertex has a colour
  Bytes parts;                                 ///< its piece of VPRT
};

/// Encodes and compresses a voxel; `shading` is null when it has no attributes. Thread-safe.
EncodedVoxel EncodeVoxel(const HotVoxel& hot, const ShadingVoxel* shading);

/// A page ready to be stored.
struct EncodedPage {
  Bytes stored;
  uint32_t decoded = 0;  ///< size of its texels in bytes
  uint64_t logical = 0;  ///< checksum of the streams, for the scene id
};

/// Encodes and compresses a page; see EncodePage(). Thread-safe.
EncodedPage EncodeTexturePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                              std::span<const std::byte> texels);

/// A written texture, with the checksums of its pages' streams for the scene id.
struct WrittenTexture {
  Texture texture;
  std::vector<uint64_t> logical;
};

/// The section VPRT of the voxels so far. Memory: 4 bytes a voxel; a byte or two for each pair of a voxel and
/// a part in it.
struct VoxelPartLists {
  Bytes bytes;                  ///< one piece after the other
  std::vector<uint32_t> sizes;  ///< of each voxel's piece, in bytes
};

/// The state of a StoreWriter apart from its file. A later process continues from it.
struct StoreProgress {
  uint64_t bytes = 0;  ///< size of the file; 0 when nothing is written
  std::vector<VoxelEntry> directory;
  std::vector<uint64_t> logical;  ///< checksums of the streams, two per voxel
  VoxelPartLists parts;
  std::vector<WrittenTexture> textures;
  bool masks = false;    ///< StoreWriter::has_masks()
  bool colored = false;  ///< StoreWriter::has_colors()
};

/// Writes a scene store: the voxels, then the textures, then all other sections. Nothing is at `path` until
/// Finish() succeeds. Not thread-safe.
/// Errors of all members: write errors, as OutputFile.
class StoreWriter {
 public:
  /// Begins a new store. Errors: as OutputFile::Create().
  static Result<StoreWriter> Create(const std::string& path);
  /// Begins the store of an environment: one texture, no voxels. Errors: as OutputFile::Create().
  static Result<StoreWriter> CreateEnvironment(const std::string& path);
  /// Continues a store whose file is `temporary`, which outlives the process. `progress` is the state at the
  /// last Flush().
  static Result<StoreWriter> Continue(const std::string& path, const std::string& temporary,
                                      StoreProgress progress);

  /// Appends voxel number voxel_count().
  Status AddVoxel(const EncodedVoxel& voxel);
  uint32_t voxel_count() const { return static_cast<uint32_t>(directory_.size()); }

  /// Begins a texture. Its pages follow in any order, each once.
  /// Requires: after the last voxel; CheckTexelLayout(layout) succeeds.
  void BeginTexture(std::string name, const TexelLayout& layout);
  /// Appends page `page` of the texture begun last. Requires: the page was not added before.
  Status AddPage(uint32_t page, const EncodedPage& encoded);
  /// Removes the texture begun last, for a texture that cannot be finished.
  Status DropTexture();
  const std::vector<WrittenTexture>& textures() const { return textures_; }

  /// States that shading blocks may have packed normals, which older programs cannot read.
  void AllowPackedNormals() { version_ = kPackedStoreVersion; }
  /// The scene's strongest emitters, at most kMostEmitters, by ascending triangle.
  void SetEmitters(std::vector<Emitter> emitters) { emitters_ = std::move(emitters); }
  /// Required of an environment before Finish().
  void SetSky(std::shared_ptr<const SkyTable> sky) { sky_ = std::move(sky); }
  /// Whether a voxel has opacity masks.
  bool has_masks() const { return masks_; }
  /// Whether a vertex has a colour.
  bool has_colors() const { return colored_; }
  /// Writes all other sections and computes the scene id. Fills in `meta`: sizes, the LZ4 version, `masks`,
  /// `uncolored`. `parts`: facts of as many parts as names, parents before children; attributes as
  /// EncodePartAttributes(). `models`: the names of
  /// the models' files, without zeros in them; not part of the scene id.
  Result<SceneId> Finish(SceneMeta meta, const std::vector<KdNode>& top_nodes,
                         const std::vector<Material>& materials, const PartTable& parts,
                         const SceneViews& views = {}, const std::vector<std::string>& models = {});
  /// Bytes in the file so far.
  uint64_t bytes_written() const { return file_.size(); }
  /// Writes the buffer out: the voxels and textures so far survive the process.
  Status Flush() { return file_.Flush(); }
  const std::vector<VoxelEntry>& directory() const { return directory_; }
  const std::vector<uint64_t>& logical() const { return logical_; }
  const VoxelPartLists& parts() const { return parts_; }

 private:
  explicit StoreWriter(OutputFile file, uint32_t sections) : file_(std::move(file)), sections_(sections) {}
  uint64_t BlocksOffset() const;
  Status PutRoom();
  OutputFile file_;
  uint32_t sections_;  ///< that Finish() writes
  std::vector<VoxelEntry> directory_;
  std::vector<uint64_t> logical_;  ///< checksums of the streams, two per voxel
  VoxelPartLists parts_;
  std::vector<WrittenTexture> textures_;
  std::vector<Emitter> emitters_;
  std::shared_ptr<const SkyTable> sky_;
  uint32_t version_ = kUnpackedStoreVersion;
  bool masks_ = false, colored_ = false;
  uint64_t texture_begin_ = 0;  ///< size of the file when the last texture began
};

}  // namespace quarry
