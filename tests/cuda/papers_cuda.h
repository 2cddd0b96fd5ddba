#pragma once

#include <variant>
#include <vector>

#include "tests/cuda/trace_cuda.h"
#include "tests/laboratory/grid.h"
#include "tests/laboratory/kd_ways.h"
#include "tests/laboratory/packet_trace.h"

// The papers' structures on a GPU: memory and launches, by the rules of trace_cuda.h. papers_cuda.cu
// implements TraceByPapers() on a GPU, papers_emulated.cpp on the CPU.

namespace quarry::cuda {

/// Textures in device memory, for as long as this lives.
class DeviceTextures {
 public:
  /// Copies the textures of `view`, which then points to the copies.
  template <class View>
  Status Upload(View& view) {
    return view.ForTextures([this](auto& texture) -> Status {
      using Element = std::remove_cvref_t<decltype(*texture.data)>;
      const std::span<const Element> elements(texture.data, texture.size);
      // Never of no bytes, so that the device's allocator has something to give.
      QUARRY_ASSIGN(DeviceMemory memory, DeviceMemory::Allocate(elements.size_bytes() + sizeof(Element)));
      QUARRY_TRY(memory.Write(0, std::as_bytes(elements)));
      texture.data = static_cast<const Element*>(memory.get());
      bytes_ += elements.size_bytes();
      memories_.push_back(std::move(memory));
      return {};
    });
  }
  uint64_t bytes() const { return bytes_; }

 private:
  std::vector<DeviceMemory> memories_;
  uint64_t bytes_ = 0;
};

/// What rays go through. Its textures lie in device memory.
using PapersStructure = std::variant<laboratory::AllTriangles, laboratory::GridView, laboratory::KdRestart,
                                     laboratory::KdBacktrack, laboratory::KdPushDown, laboratory::RopesView>;

/// Traces the chosen rays, a thread a ray. Results: see TraceInPacket(). Returns: seconds that the kernel
/// took.
Result<double> TraceByPapers(const PapersStructure& structure, const laboratory::TriangleCorners& corners,
                             const DeviceRays& rays);

}  // namespace quarry::cuda
