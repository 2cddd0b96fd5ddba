#pragma once

#include <cstdint>

#include "common/engine/integrators/path/path_numbers.h"
#include "common/engine/surfaces/surface_packet.h"

namespace quarry {

/// The state of the paths of a packet in mode `path`, one array per field, beside SamplePacket. A vertex
/// decides where its path goes on before the light ray leaves, so that its surface is looked at once.
struct PathPacket {
  PathNumbers numbers;  ///< of the vertices
  uint64_t seen;        ///< lanes whose ray comes from the eye, straight or by mirrors and glass
  Vectors radiance;     ///< found so far, summed up in the order of the path
  Vectors next_direction, next_weight;   ///< of the ray that goes on from the vertex; weight 0: none
  float next_density[RayPacket::kRays];  ///< see PathBsdf::Sample
  float next_width[RayPacket::kRays];
  Vectors vertex, vertex_side;  ///< from which the ray under way comes, as PathLights::Vertex
  float
      density[RayPacket::kRays];  ///< with which the ray under way was chosen; 0: lights could not choose it
  float light_end[RayPacket::kRays];  ///< where the light ray ends; units: t
  uint64_t to_texel;       ///< lanes whose light ray goes to the environment, or to an emitter with a map
  uint64_t at_texel;       ///< lanes whose ray has come there, so that the texel is looked up
  uint64_t ends_at_texel;  ///< lanes whose path ends there
  uint64_t of_map;         ///< lanes whose texel is that of an emitter's map
  uint32_t texel[RayPacket::kRays];  ///< of the environment; or the emitter's number, see PathLights::Sample
};

}  // namespace quarry
