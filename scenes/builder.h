#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry::scenes {

/// A vertex of a mesh; the colour, linear, multiplies the material's diffuse.
struct MeshVertex {
  glm::vec3 position;
  uint8_t r, g, b;
};

/// A triangle of a mesh, counter-clockwise from outside; indices count from the first vertex of the same
/// mesh.
struct MeshFace {
  uint32_t a, b, c;
  uint16_t material;
};

/// A piece of one part, with vertices of its own.
struct Mesh {
  std::vector<MeshVertex> vertices;
  std::vector<MeshFace> faces;
};

/// Takes a scene piece by piece. An error ends the generation.
class MeshReceiver {
 public:
  virtual ~MeshReceiver() = default;
  /// All pieces of a part come in a row; parts are numbered from 0 in the order they come.
  virtual Status BeginPart(uint32_t part, const std::string& name) = 0;
  virtual Status AddPiece(const Mesh& mesh, uint32_t part) = 0;
  /// False while it looks at faces only: generators to which positions are dear may then leave them out.
  virtual bool WantsPositions() const { return true; }
};

/// Leaves a generator early, out of any depth, when its receiver fails; caught where the generation was
/// started.
struct GenerationStopped {
  Error error;
};

/// What generators draw into: collects shapes and hands them on in pieces of bounded size, so that memory
/// does not depend on the scene. Shapes (shapes.h) call BeginShape() once and then refer to vertices added
/// since.
class Builder {
 public:
  explicit Builder(MeshReceiver& receiver);

  /// Starts a part; one that stays empty leaves no trace. Names are to be unique.
  void Part(std::string name);
  /// Material and tint (0 to 1) of what follows.
  void Use(uint16_t material, const glm::vec3& tint = glm::vec3(1.0f));
  /// Lets go of vertices added so far if they are many.
  void BeginShape();
  uint32_t Vertex(const glm::vec3& position);
  void Triangle(uint32_t a, uint32_t b, uint32_t c);
  void Quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d);
  /// Hands on what is left; call it at the end.
  void Finish();

  /// False if positions and tints do not matter for now; their number does.
  bool wants_positions() const { return wants_positions_; }
  /// All triangles so far.
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

/// A share of the triangles: what is still to be drawn up to a total count. Shapes round their tessellation,
/// so a generator asks for Room() again before each item instead of planning exactly.
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
