#pragma once

#include <TDocStd_Document.hxx>
#include <string>

#include "common/base/status.h"
#include "preprocess/import/cad/cad_protocol.h"
#include "preprocess/import/cad/open_cascade/cad_output.h"

namespace quarry {

/// The shapes of a file with their names, colours and places, in millimetres.
struct CadDocument {
  Handle(TDocStd_Document) document;
  std::string unit = "mm";  ///< of the file: "mm", "in", ...
  double millimetres = 1;   ///< of a unit
};

/// Shares of the work, for progress.
inline constexpr double kCadRead = 0.15, kCadTransferred = 0.5;

/// Reads a STEP or IGES file. Gives warnings and progress to `out`. Errors, an end of a sentence about the
/// file: Open CASCADE cannot read it; nothing is in it.
Result<CadDocument> ReadCadDocument(CadFormat format, const std::string& path, CadOutput& out);

}  // namespace quarry
