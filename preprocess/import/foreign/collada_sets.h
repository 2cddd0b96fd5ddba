#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "common/scene/material.h"

namespace quarry {

/// The sets of texture coordinates that the materials of a COLLADA file use. Assimp takes the number of a set
/// from the digits in its name ("CHANNEL1") and reads no `bind_vertex_input`, which binds the name to a set.
/// Source: COLLADA 1.4.1, chapter 5, bind_vertex_input. Thread safety: none.
class ColladaSets {
 public:
  /// Reads the bindings of the file. A file that is damaged or no COLLADA gives the bindings before the
  /// error.
  static ColladaSets Read(const std::string& path);

  /// The mesh's channel, in Assimp's numbers, that the texture of `material`, a name or id, uses. `fallback`:
  /// Assimp's own choice, for a material that is not bound.
  uint32_t ChannelOf(const std::string& material, TextureUse use, uint32_t fallback) const;

 private:
  friend class ColladaParser;
  struct Bound {
    std::string effect, geometry;
    std::map<std::string, uint32_t> sets;  ///< by the name that the effect uses
  };
  std::map<std::string, Bound> materials_;                            ///< by id
  std::map<std::string, std::string> ids_;                            ///< of materials, by name
  std::map<std::string, std::map<TextureUse, std::string>> effects_;  ///< names of coordinates, by id and use
  /// Of each geometry, by id, the channels of its sets: Assimp numbers the existing sets without gaps. Under
  /// "" the channels of the whole file, for geometries behind a skin.
  std::map<std::string, std::map<uint32_t, uint32_t>> channels_;
};

}  // namespace quarry
