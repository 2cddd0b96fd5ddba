#pragma once

#include <NCollection_DataMap.hxx>
#include <Quantity_ColorRGBA.hxx>
#include <TDF_Label.hxx>
#include <TopTools_ShapeMapHasher.hxx>
#include <TopoDS_Shape.hxx>
#include <optional>

#include "preprocess/import/cad/open_cascade/cad_assembly.h"

namespace quarry {

/// The colours of a shape and of its faces, read once for all of its instances.
class CadStyles {
 public:
  CadStyles(const TDF_Label& definition, const TopoDS_Shape& shape);

  /// The colour of a face of the shape in one of its instances. The first that exists: the face's colour, the
  /// instance's, the whole shape's, the colour of the assembly around the instance. Nothing: none exists.
  std::optional<Quantity_ColorRGBA> ColorOf(const TopoDS_Shape& face, const CadInstance& instance) const;
  /// Whether the file hides a face.
  bool IsHidden(const TopoDS_Shape& face) const;

 private:
  struct Style {
    std::optional<Quantity_ColorRGBA> color;
    bool visible = true;
    int rank = 0;  ///< of the kind of shape that it comes from: a face goes before a solid
  };
  NCollection_DataMap<TopoDS_Shape, Style, TopTools_ShapeMapHasher> faces_;
  std::optional<Quantity_ColorRGBA> whole_;
};

}  // namespace quarry
