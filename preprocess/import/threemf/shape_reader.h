#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/bytes.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/import/threemf/structure.h"
#include "preprocess/import/threemf/triangle_look.h"
#include "preprocess/import/threemf/xml_reader.h"

namespace quarry {

/// Gives the triangles of a 3MF's parts to a sink, once for each instance. A small object is held, and given
/// instance after instance; of a larger one each vertex and triangle is given for all instances at once, so
/// that no part is read again. Memory: 8 MiB. Thread safety: none.
class ShapeReader final : public XmlHandler {
 public:
  /// Limits of an object that is held.
  static constexpr uint64_t kMostHeldVertices = 1 << 16, kMostHeldTriangles = 1 << 17;

  ShapeReader(const std::string& path, const ThreeMfStructure& structure, ModelSink& sink)
      : path_(path), s_(structure), sink_(sink) {}

  void BeginPart(uint32_t part);
  Status Start(XmlSpace space, std::string_view name, const XmlAttributes& attributes) override;
  Status End(XmlSpace space, std::string_view name) override;
  bool failed_elsewhere() const override { return sink_failed_; }

  /// Warns of materials and colours that triangles do without. Requires: all parts have been read.
  void Finish();
  /// Of all instances.
  uint64_t triangles() const { return triangles_; }

 private:
  struct Face {
    uint32_t vertex[3];
    ThreeMfProperties::Look look[3];
  };
  struct Instance {
    glm::dmat4 world;
    uint32_t part;
    bool mirrored;
  };

  Status BeginObject(const XmlAttributes& attributes);
  Status EndObject();
  Status Vertex(const XmlAttributes& attributes);
  Status Triangle(const XmlAttributes& attributes);
  /// Whether the corners have colours that differ.
  static bool IsBlended(const Face& face) {
    return face.look[0].colored && (face.look[0] != face.look[1] || face.look[0] != face.look[2]);
  }
  ThreeMfProperties::Look LookOf(uint32_t group, uint32_t index);
  Instance ToInstance(const glm::dmat4& world, const std::vector<uint32_t>& way);
  Status GiveHeld(const Instance& instance);
  Status GiveFace(const Face& face, const uint32_t (&corners)[3], const Instance& instance);
  /// Passes a status of the sink on.
  Status Sent(Status status) {
    sink_failed_ |= !status;
    return status;
  }
  Status SetColor(const Rgba8& color);
  const ThreeMfStructure::Object& Object() const { return s_.objects[object_]; }

  const std::string& path_;
  const ThreeMfStructure& s_;
  ModelSink& sink_;
  uint32_t part_ = 0, next_object_ = 0, object_ = 0;
  int depth_ = 0, skipped_ = 0;  ///< depths of elements, from 1; 0: none
  bool in_object_ = false, in_mesh_ = false, shown_ = false, held_ = false, sink_failed_ = false;
  uint64_t vertex_ = 0;  ///< vertices of the object so far
  std::vector<glm::dvec3> vertices_;
  std::vector<Face> faces_;
  std::vector<Instance> instances_;
  uint64_t positions_ = 0, triangles_ = 0;
  bool looks_missing_ = false;         ///< of the current triangle
  uint64_t plain_ = 0, averaged_ = 0;  ///< triangles with missing looks, and with mean colours
  uint32_t face_color_ = Packed(Rgba8());
};

}  // namespace quarry
