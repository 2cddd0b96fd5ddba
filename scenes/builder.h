#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry::scenes {

/// A vertex of a mesh. Units: metres; the linear colour multiplies the material's diffuse.
struct MeshVertex {
  glm::vec3 position;
  uint8_t r, g, b;
};

/// A triangle of a mesh, counter-clockwise from outside; indices count from the mesh's first vertex.
struct MeshFace {
  uint32_t a, b, c;
  uint16_t material;
};

/// A piece of a part, with vertices of its own.
struct Mesh {
  std::vector<MeshVertex> vertices;
  std::vector<MeshFace> faces;
};

/// Receives a scene piece by piece. An error ends the generation.
class MeshReceiver {
 public:
  virtual ~MeshReceiver() = default;
  /// Starts a part; its pieces follow. Parts are numbered from 0 in the order of their coming.
  virtual Status BeginPart(uint32_t part, const std::string& name) = 0;
  virtual Status AddPiece(const Mesh& mesh, uint32_t part) = 0;
  /// False: only faces are wanted, and generators may leave positions out.
  virtual bool WantsPositions() const { return true; }
};

/// Thrown to leave a generator when its receiver fails; caught where the generation was started.
struct GenerationStopped {
  Error error;
};

/// Collects the shapes that generators draw and hands them on in pieces of bounded size, so that memory does
/// not depend on the scene. A shape (shapes.h) calls BeginShape() once and then refers to vertices added
/// since. Thread safety: none.
class Builder {
 public:
  explicit Builder(MeshReceiver& receiver);

  /// Starts a part; an empty part is dropped. Requires: names are unique.
  void Part(std::string name);
  /// Sets the material and tint (0 to 1) of the shapes that follow.
  void Use(uint16_t material, const glm::vec3& tint = glm::vec3(1.0f));
  /// Hands on the vertices added so far if they are many.
  void BeginShape();
  uint32_t Vertex(const glm::vec3& position);
  void Triangle(uint32_t a, uint32_t b, uint32_t c);
  void Quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d);
  /// Hands on the rest. Required at the end.
  void Finish();

  /// False: positions and tints have no effect; their number has.
  bool wants_positions() const { return wants_positions_; }
  /// All triangles drawn so far.
  uint64_t triangles() const { return triangles_; }

 private:
  void Flush();

  MeshReceiver& receiver_;
  bool wants_positions_;
  Mesh mesh_;
  std::string part_name_;
  uint32_t part_ = 0;
  bool part_begun_ = false;
  uint64_t triangles_ = 0;
  uint16_t material_ = 0;
  uint8_t tint_[3] = {255, 255, 255};
};

/// A budget of triangles: the rest up to a total count. Shapes round their tessellation, so a generator asks
/// for Room() before each item instead of planning exactly.
class Budget {
 public:
  Budget(const Builder& builder, uint64_t limit) : builder_(builder), limit_(limit) {}
  uint64_t Room() const { return limit_ > builder_.triangles() ? limit_ - builder_.triangles() : 0; }
  /// An equal share of the room for each of `items` items.
  double Share(uint64_t items) const {
    return static_cast<double>(Room()) / static_cast<double>(items ? items : 1);
  }
  /// A budget for the next `share` triangles of this one.
  Budget Next(double share) const {
    const auto next = builder_.triangles() + static_cast<uint64_t>(share);
    return Budget(builder_, next < limit_ ? next : limit_);
  }

 private:
  const Builder& builder_;
  uint64_t limit_;
};

}  // namespace quarry::scenes
