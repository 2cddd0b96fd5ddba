#pragma once

#include <string>
#include <vector>

/// A part that a test has written.
struct WrittenPart {
  std::string path;                 ///< in the assembly
  double volume = 0;                ///< of the exact shape, in cubic units of the file
  std::vector<std::string> colors;  ///< "#rrggbb", sorted; empty: none
};

/// The assembly that a test wants.
struct WantedAssembly {
  int parts = 0;
  int shapes = 0;           ///< different ones; parts beyond are instances of these
  std::string unit = "MM";  ///< as the library names it
  bool apart = false;       ///< a STEP file for each shape, beside that of the assembly, which names them
};

/// Writes an assembly of racks of a hundred parts: blocks with holes, bars, balls, rings and cones of every
/// size, with colours of shapes, of faces and of instances, at places and turns. STEP, or IGES by the
/// extension. Returns: the parts; empty: it could not be written.
std::vector<WrittenPart> WriteAssembly(const std::string& path, const WantedAssembly& wanted);
