#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/threemf/instance_graph.h"
#include "preprocess/import/threemf/properties.h"
#include "preprocess/import/threemf/zip_archive.h"
#include "preprocess/import/warn_once.h"

namespace quarry {

/// A 3MF without its vertices and triangles, but with their numbers: all must be known before the first
/// triangle is given to the sink. Bytes: about 150 an object or use, 4 a colour, and names.
struct ThreeMfStructure {
  static constexpr size_t kMostObjects = 1 << 16;

  struct Part {
    uint64_t entry;             ///< in the archive
    double unit_in_metres = 0;  ///< 0: not read yet
    uint32_t first_object = 0, objects = 0;
  };
  struct Object {
    uint32_t part, id;
    std::string name;
    uint32_t group = 0, index = 0;  ///< of its triangles that state no look; group 0: none
    uint64_t vertices = 0, triangles = 0;
    uint64_t blended = 0;  ///< triangles whose corners name different looks
  };

  std::vector<Part> parts;  ///< the first is the one that the archive names
  std::vector<Object> objects;
  InstanceGraph graph;
  ThreeMfProperties properties;
  bool uses_properties = false;  ///< whether any object or triangle names a group
};

/// Reads all parts that the model consists of, each once. Errors: XML or numbers that are no 3MF; a limit;
/// references to objects or parts that are not there; an extension is required that is not read.
Result<ThreeMfStructure> ReadThreeMfStructure(ZipArchive& archive, uint64_t model_part, WarnOnce& warn);

}  // namespace quarry
