#pragma once

#include <span>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "tests/cuda/trace_cuda.h"
#include "tests/laboratory/gpu/packet_trace.h"
#include "tests/laboratory/structures/grid.h"
#include "tests/laboratory/structures/kd_ways.h"

// The laboratory's structures on a GPU: memory and launches, by the rules of trace_cuda.h. device_trace.cu
// implements TraceOnDevice() on a GPU, device_trace_emulated.cpp on the CPU.

namespace quarry::laboratory {

/// Textures in device memory, for as long as this lives.
class DeviceTextures {
 public:
  /// Copies the textures of `view`. Returns: the view of the copies.
  template <class View>
  Result<View> Upload(View view) {
    QUARRY_TRY(view.ForTextures([this](auto& texture) -> Status {
      using Element = std::remove_cvref_t<decltype(*texture.data)>;
      const std::span<const Element> elements(texture.data, texture.size);
      // Of an empty texture too, so that no address of the host is left.
      QUARRY_ASSIGN(cuda::DeviceMemory memory,
                    cuda::DeviceMemory::Allocate(elements.size_bytes() + sizeof(Element)));
      if (!elements.empty()) QUARRY_TRY(memory.Write(0, std::as_bytes(elements)));
      texture.data = static_cast<const Element*>(memory.get());
      bytes_ += elements.size_bytes();
      memories_.push_back(std::move(memory));
      return {};
    }));
    return view;
  }
  /// Of all textures together.
  uint64_t bytes() const { return bytes_; }

 private:
  std::vector<cuda::DeviceMemory> memories_;
  uint64_t bytes_ = 0;
};

/// The structure that rays traverse. Its textures lie in device memory.
using DeviceStructure = std::variant<AllTriangles, GridView, KdRestart, KdBacktrack, KdPushDown, RopesView>;

/// Traces the chosen rays, a thread a ray. Results: see TraceInPacket(). Returns: seconds that the kernel
/// took.
Result<double> TraceOnDevice(const DeviceStructure& structure, const TriangleCorners& corners,
                             const cuda::DeviceRays& rays);

}  // namespace quarry::laboratory
