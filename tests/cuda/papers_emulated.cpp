// papers_cuda.h without a GPU: one thread after another.
#include <chrono>

#include "common/base/resource.h"
#include "tests/cuda/papers_cuda.h"

namespace quarry::cuda {

Result<double> TraceByPapers(const PapersStructure& structure, const laboratory::TriangleCorners& corners,
                             const DeviceRays& rays) {
  const RayList list = rays.list();
  const auto start = std::chrono::steady_clock::now();
  std::visit(
      [&](const auto& of) {
        for (uint32_t i = 0; i < list.count; ++i)
          laboratory::TraceInPacket(of, corners, list.packet(i), list.place(i));
      },
      structure);
  return SecondsSince(start);
}

}  // namespace quarry::cuda
