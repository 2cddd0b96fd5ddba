#pragma once

#include <cstddef>
#include <cstdint>

// Messages between quarry-preprocess and quarry-import-draco through pipes. Both run on one machine, from one
// build.
// Request: uint64 bytes of the compressed mesh, uint32 number of attributes, their ids as uint32; then the
// compressed bytes.
// Answer: uint32 DracoAnswer, uint32 bytes that follow at once. After kMesh these are uint64 points, uint64
// corners, and of each attribute, in the request's order, uint32 component type (glTF's number), uint32
// components, uint32 whether it is normalised. Then come, uncounted, the corners' points as uint32, and the
// attributes, each packed, a value for each point. After the other answers the bytes are a sentence.

namespace quarry {

enum class DracoAnswer : uint32_t {
  kMesh = 1,
  kRefused,   ///< damaged, or not as glTF has it
  kNewer,     ///< of a version that the library does not know
  kTooLarge,  ///< the helper has too little memory
};

inline constexpr size_t kDracoRequestBytes = 12, kDracoAnswerBytes = 8;
inline constexpr uint32_t kMostDracoAttributes = 64;
/// Bytes that follow an answer at once, at most.
inline constexpr uint32_t kMostDracoFacts = 4096;

}  // namespace quarry
