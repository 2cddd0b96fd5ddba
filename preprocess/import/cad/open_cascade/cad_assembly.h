#pragma once

#include <Quantity_ColorRGBA.hxx>
#include <TDF_Label.hxx>
#include <TopLoc_Location.hxx>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/import/cad/open_cascade/cad_document.h"

namespace quarry {

/// A shape at a place of an assembly.
struct CadInstance {
  size_t definition = 0;  ///< in CadAssembly::definitions
  TopLoc_Location place;
  std::string part;  ///< names from the root on, joined by "/"; empty: nothing has a name
  std::optional<Quantity_ColorRGBA> own;        ///< of this instance: replaces the shape's colour
  std::optional<Quantity_ColorRGBA> inherited;  ///< of the assembly around it: for shapes that have none
};

/// The shapes that a document shows, in the document's order.
struct CadAssembly {
  std::vector<TDF_Label> definitions;  ///< shapes that are no assemblies, each once
  std::vector<CadInstance> instances;
  size_t hidden = 0;    ///< instances that the document does not show
  size_t too_deep = 0;  ///< assemblies below 256 others, whose shapes are left out
};

/// Walks a document from its roots to its shapes. Siblings of one name get ":2", ":3", ... behind it.
CadAssembly WalkAssembly(const CadDocument& document);

}  // namespace quarry
