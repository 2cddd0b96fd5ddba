#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/foreign/helper_process.h"
#include "preprocess/import/gltf/draco/draco_protocol.h"

namespace quarry {

/// Facts of a decoded mesh, known before its bytes.
struct DracoFacts {
  struct Attribute {
    uint32_t component_type = 0;  ///< glTF's number
    uint32_t components = 0;
    bool normalized = false;
    uint64_t value_bytes() const;
  };
  uint64_t points = 0, corners = 0;
  std::vector<Attribute> attributes;  ///< in the order asked for
};

/// The process that decodes Draco's meshes, started with the first. Thread safety: none.
class DracoDecoder {
 public:
  /// Units: `memory` in bytes, that the process may take beyond its libraries. An empty `program` is not
  /// there.
  DracoDecoder(std::string program, uint64_t memory) : helper_(std::move(program), memory) {}

  using ReadPiece = std::function<Status(uint64_t offset, std::span<std::byte> out)>;
  using OnPiece = std::function<Status(std::span<const std::byte>)>;
  /// Decodes a mesh of `bytes` compressed bytes, which `read` fills in. Passes to `piece` in order: the
  /// points of the corners as uint32; the attributes of these ids, packed. Requires: at most
  /// kMostDracoAttributes. Errors, an end of a sentence about the mesh: there is no such program; it cannot
  /// decode the mesh, takes too much memory or time, or crashes; the callbacks'.
  Result<DracoFacts> Decode(uint64_t bytes, const ReadPiece& read, std::span<const uint32_t> ids,
                            const OnPiece& piece);

 private:
  Status Ask(uint64_t bytes, const ReadPiece& read, std::span<const uint32_t> ids);
  Result<DracoFacts> ReceiveFacts(size_t attributes);
  Status Receive(uint64_t bytes, const OnPiece& piece);
  tl::unexpected<Error> Ended();

  HelperProcess helper_;
};

}  // namespace quarry
