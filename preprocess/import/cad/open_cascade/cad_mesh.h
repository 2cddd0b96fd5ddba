#pragma once

#include <TopoDS_Shape.hxx>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/import/cad/open_cascade/cad_assembly.h"
#include "preprocess/import/cad/open_cascade/cad_output.h"
#include "preprocess/import/cad/open_cascade/cad_styles.h"

namespace quarry {

/// How close triangles come to surfaces.
struct CadDeflection {
  double linear = 0;  ///< most distance from the surface, of the file's unit; 0: by the model's size
  double angle = 0;   ///< degrees between neighbouring triangles of a curved face; 0: the default
};

/// Makes triangles of an assembly's shapes and sends them, instance by instance. A shape is meshed at its
/// first instance and forgets its triangles behind its last.
class CadMesher {
 public:
  /// All arguments outlive the mesher.
  CadMesher(const CadDocument& document, const CadAssembly& assembly, CadDeflection deflection,
            CadOutput& out);

  /// Sends facts, materials, parts and faces, warnings about shapes that are left out, and the end. False:
  /// memory has become short.
  bool Run();

 private:
  /// A definition of the assembly.
  struct Shape {
    TopoDS_Shape shape;
    size_t uses = 0;  ///< instances to come
    std::unique_ptr<CadStyles> styles;
  };

  void SendFacts();
  void Mesh(const TopoDS_Shape& shape) const;
  void SendInstance(const CadInstance& instance, const Shape& shape);
  uint32_t MaterialOf(const std::optional<Quantity_ColorRGBA>& color);
  void WarnOfLosses() const;

  const CadDocument& document_;
  const CadAssembly& assembly_;
  CadDeflection deflection_;
  CadOutput& out_;
  std::vector<Shape> shapes_;
  std::map<std::array<float, 4>, uint32_t> materials_;
  uint64_t faces_ = 0, hidden_faces_ = 0;
  /// Something that is left out, with the part that it was first met in.
  struct Loss {
    uint64_t count = 0;
    std::string part;
  };
  Loss without_triangles_, without_faces_;
};

}  // namespace quarry
