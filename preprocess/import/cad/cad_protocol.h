#pragma once

#include <cstddef>
#include <cstdint>

// Messages between quarry-preprocess and quarry-import-cad through pipes. Both run on one machine, from one
// build.
// Request, one a process: uint32 CadFormat, uint32 bytes of the path, double linear deflection in the file's
// unit (0: by the model's size), double angular deflection in degrees; then the path. Answer: messages, each
// uint32 CadMessage, uint32 bytes of its content, the content. The last is kDone, kRefused or kTooLarge.

namespace quarry {

enum class CadFormat : uint32_t { kNone = 0, kStep, kIges };

enum class CadMessage : uint32_t {
  kProgress = 1,  ///< double: the share of the work that is done
  kWarning,       ///< an end of a sentence about the file
  kFacts,         ///< doubles x, y, z of a point in the midst; linear, angular deflection; the unit as text
  kMaterial,      ///< floats r, g, b, opacity, linear; numbered from 0
  kPart,          ///< names from the root to the part of the coming faces, each ended by a zero
  kFace,          ///< uint32 number of its material, or kNoIndex; begins a face without points
  kPoints,        ///< doubles x, y, z of points of the face, in the file's unit
  kNormals,       ///< floats x, y, z, as many as points before; a face has none or all
  kTriangles,     ///< uint32 numbers of points of the face, three a triangle; behind all points and normals
  kDone,          ///< uint64 parts, uint64 faces
  kRefused,       ///< an end of a sentence: the file cannot be read
  kTooLarge,      ///< the helper has too little memory
};

inline constexpr size_t kCadRequestBytes = 24, kCadHeaderBytes = 8;
/// Bytes of a message's content, at most.
inline constexpr uint32_t kMostCadMessage = 1 << 20;
/// Bytes of a path, a name or a sentence, at most.
inline constexpr uint32_t kMostCadText = 1 << 16;

}  // namespace quarry
