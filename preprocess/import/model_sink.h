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
#include "preprocess/import/smoothing.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/import/work_team.h"

namespace quarry {

/// A corner of a polygon: indices, from 0, into the streams of the current file. `normal` and `uv` may be
/// kNoIndex.
struct Corner {
  uint32_t position = kNoIndex;
  uint32_t normal = kNoIndex;
  uint32_t uv = kNoIndex;
};

/// A linear colour of a vertex or face. Units: value / 255 multiplies the material's diffuse.
struct Rgba8 {
  uint8_t r = 255, g = 255, b = 255, a = 255;
};

/// Steps of the vertices' alpha below 1.
inline constexpr uint32_t kAlphaLevels = 16;

/// The colour as 32 bits, r in the lowest byte.
inline uint32_t Packed(const Rgba8& c) {
  return static_cast<uint32_t>(c.r) | static_cast<uint32_t>(c.g) << 8 | static_cast<uint32_t>(c.b) << 16 |
         static_cast<uint32_t>(c.a) << 24;
}

/// Receives model files as streams, one after the other, in file order; an importer keeps nothing per
/// element. Positions, normals and uvs of a file are numbered from 0 in the order given. A polygon may refer
/// to elements that come later in the file (OBJ allows it); the sink checks indices when the file ends.
/// Units: the model's. Thread safety: none. Errors end the import: importers return them unchanged.
class ModelSink {
 public:
  virtual ~ModelSink() = default;

  /// Starts a file. `name`, without folders, is the part of faces that have none. Where there are several
  /// files, it is the parent of the file's parts too.
  virtual Status BeginFile(std::string_view name) = 0;
  /// Ends the file. Errors: a corner index beyond the elements given.
  virtual Status EndFile() = 0;

  /// Each registers a material or part and returns its index in the scene. `parent`: the part that the part
  /// belongs to; kNoIndex: none. Equal names below one parent within a file are one part.
  virtual uint32_t AddMaterial(const Material& material) = 0;
  virtual uint32_t AddPart(std::string_view name, uint32_t parent) = 0;
  /// A part of its own, even if another below the parent has the name: " #2" is added then, or " #3".
  virtual uint32_t AddSibling(std::string_view name, uint32_t parent) = 0;
  /// States what the model says of a part beside its name, as a JSON object: at most once of a part, after it
  /// is added and before the next one. An object beyond PartAttributes' limits is left out with a warning.
  virtual void SetAttributes(uint32_t /*part*/, std::string /*json*/) {}

  /// Makes the vertices' alpha count for `material`: a triangle whose corners have the mean alpha n /
  /// kAlphaLevels, rounded, gets the material `first` + n in its place; one of alpha 1 keeps it. Before the
  /// first such polygon. Errors: disk full.
  virtual Status SetAlphaLevels(uint32_t /*material*/, uint32_t /*first*/) { return {}; }

  /// Whether importers should give textures; otherwise they look for no image.
  virtual bool takes_textures() const = 0;
  /// Registers an image for later materials and returns the index for their bindings. The same bytes of the
  /// same file for the same use share an index. Errors: more than kMaxTextures; disk full.
  virtual Result<uint32_t> AddTexture(TextureImage image) = 0;

  /// Each adds a camera or light in model coordinates. Cameras and lights beyond the store's limit are left
  /// out with a warning.
  virtual void AddCamera(NamedCamera /*camera*/) {}
  virtual void AddLight(NamedLight /*light*/) {}
  /// Whether the sink wants SetOrigin() before the first position: a point in the midst of the model.
  virtual bool WantsOrigin() const { return false; }
  virtual void SetOrigin(const glm::dvec3& /*place*/) {}

  /// Each adds the next element. A position may be NaN or infinite: the sink drops and counts triangles with
  /// such corners. Errors: disk full.
  virtual Status AddPosition(const glm::dvec3& position, const Rgba8& color) = 0;
  virtual Status AddNormal(const glm::vec3& normal) = 0;
  virtual Status AddUv(const glm::vec2& uv) = 0;

  /// The colour of the polygons that follow in this file; it replaces their vertices' colours. White: none.
  virtual Status SetFaceColor(const Rgba8& /*color*/) { return {}; }
  /// How the polygons that follow in this file are smoothed where they have no normals: a number of
  /// import/smoothing.h. At first by angle.
  virtual void SetSmoothing(uint16_t /*smoothing*/) {}
  /// Adds a polygon, concave or not, which the sink splits into corners.size() - 2 triangles with consecutive
  /// ids (import/polygon/triangulation.h). Fewer than 3 corners add nothing. kNoIndex as material is the
  /// default material, as part the file's own.
  virtual Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) = 0;

  /// The threads with which importers may decode; null: none.
  virtual WorkTeam* team() { return nullptr; }

  /// Reports a line to the user; the statistics count it.
  virtual void Warn(std::string message) = 0;

  /// Informs the user how a file was read; the run's summary repeats it.
  virtual void Note(std::string /*message*/) {}

  /// Reports progress. Units: bytes of the file.
  virtual void HasRead(uint64_t /*done*/, uint64_t /*total*/) {}
};

}  // namespace quarry
