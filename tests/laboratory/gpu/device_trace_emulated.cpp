// device_trace.h without a GPU: one thread after another.
#include <chrono>

#include "common/base/resource.h"
#include "tests/laboratory/gpu/device_trace.h"

namespace quarry::laboratory {

Result<double> TraceOnDevice(const DeviceStructure& structure, const TriangleCorners& corners,
                             const cuda::DeviceRays& rays) {
  const RayList list = rays.list();
  const auto start = std::chrono::steady_clock::now();
  std::visit(
      [&](const auto& of) {
        for (uint32_t i = 0; i < list.count; ++i) TraceInPacket(of, corners, list.packet(i), list.place(i));
      },
      structure);
  return SecondsSince(start);
}

}  // namespace quarry::laboratory
