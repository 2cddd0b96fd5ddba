#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <string>
#include <string_view>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/material.h"
#include "common/scene/scene_views.h"
#include "preprocess/import/texture_image.h"

namespace quarry {

/// One corner of a polygon: indices into the streams of the file at hand, from 0. `normal` and `uv` may be
/// kNoIndex.
struct Corner {
  uint32_t position = kNoIndex;
  uint32_t normal = kNoIndex;
  uint32_t uv = kNoIndex;
};

/// A colour of a vertex or face, linear: value / 255 multiplies the material's diffuse.
struct Rgba8 {
  uint8_t r = 255, g = 255, b = 255, a = 255;
};

/// r lowest.
inline uint32_t Packed(const Rgba8& c) {
  return static_cast<uint32_t>(c.r) | static_cast<uint32_t>(c.g) << 8 | static_cast<uint32_t>(c.b) << 16 |
         static_cast<uint32_t>(c.a) << 24;
}

/// Receives one model file after another as a stream, in file order; holds nothing per element for the
/// importer. Within a file positions, normals and uvs are numbered from 0 in the order given. A polygon may
/// refer to elements that come later in the same file (OBJ allows it); the sink checks the indices when the
/// file ends. Not thread-safe. An error ends the import: the importer returns it unchanged.
class ModelSink {
 public:
  virtual ~ModelSink() = default;

  /// Starts a file; `name` (without folders) is the part of faces that have none of their own.
  virtual Status BeginFile(std::string_view name) = 0;
  /// Ends it. Errors: a corner index beyond the elements given.
  virtual Status EndFile() = 0;

  /// Registers a material, a part; returns its index in the scene. Equal part names within a file are one
  /// part.
  virtual uint32_t AddMaterial(const Material& material) = 0;
  virtual uint32_t AddPart(std::string_view name) = 0;

  /// Whether textures are wanted; if not, importers look for no image and give none.
  virtual bool takes_textures() const = 0;
  /// Registers an image for materials that come after; returns the index for their bindings. The same bytes
  /// of the same file for the same use have one. Errors: more than kMaxTextures; disk full.
  virtual Result<uint32_t> AddTexture(TextureImage image) = 0;

  /// A camera, a light of the model, in its coordinates. More than there may be are warned of and left out.
  virtual void AddCamera(NamedCamera /*camera*/) {}
  virtual void AddLight(NamedLight /*light*/) {}
  /// Whether the sink would know of a place in the midst of the model before it comes.
  virtual bool WantsOrigin() const { return false; }
  virtual void SetOrigin(const glm::dvec3& /*place*/) {}

  /// Positions may be NaN or infinite: triangles with such corners are dropped and counted by the sink.
  virtual Status AddPosition(const glm::dvec3& position, const Rgba8& color) = 0;
  virtual Status AddNormal(const glm::vec3& normal) = 0;
  virtual Status AddUv(const glm::vec2& uv) = 0;

  /// The colour of polygons that follow in this file, in place of their vertices'; white: they have none.
  virtual Status SetFaceColor(const Rgba8& /*color*/) { return {}; }
  /// A polygon of 3 or more corners, concave or not, split by the sink into as many triangles less 2
  /// (import/triangulation.h); each gets the next triangle id. Fewer than 3 corners add nothing. kNoIndex as
  /// material means the default material, as part the file's own.
  virtual Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) = 0;

  /// One line for the person at the terminal, and counted in the statistics (a missing MTL, say).
  virtual void Warn(std::string message) = 0;

  /// How far into the file its reader is, in bytes; for progress.
  virtual void HasRead(uint64_t /*done*/, uint64_t /*total*/) {}
  /// After BeginFile: the file cannot be read a second time, or not to the same effect, so that checkpoints
  /// would be of no use.
  virtual void ReadsOnce() {}
  /// Importers of files that may be huge ask this between elements; it is cheap. True: Checkpoint is due.
  virtual bool CheckpointDue() { return false; }
  /// Makes what was given so far outlast the process, along with `state`, from which the importer can go on.
  /// Errors: disk full.
  virtual Status Checkpoint(const Bytes& /*state*/) { return {}; }
  /// After BeginFile: the state of the last checkpoint that an earlier process made in this file; empty:
  /// there is none. What was given before it must not be given again.
  virtual std::span<const std::byte> LastCheckpoint() const { return {}; }
  /// After BeginFile: an earlier process was given all of the file, and did not come to the end of EndFile.
  virtual bool HasAll() const { return false; }
};

}  // namespace quarry
