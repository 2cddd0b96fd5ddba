#include "tests/laboratory/variants/all_kernels.h"

#include <algorithm>
#include <vector>

#include "common/kdtree/instruction_sets.h"

namespace quarry {
namespace {

std::vector<Variant> MakeAll() {
  std::vector<Variant> all;
  for (const Kernel& kernel : Kernels()) {
    const KernelFunctions& functions = kernel;
    all.push_back({functions, kernel.isa, NameOf(kernel.grouping), "treelets", test::TreeLayout::kTreelets});
  }
  if (std::ranges::count(InstructionSets(), "scalar") != 0)
    all.insert(all.end(), GpuKernels().begin(), GpuKernels().end());
  return all;
}

}  // namespace

std::string Variant::name() const {
  return std::string(isa).append(" ").append(grouping).append(" ").append(algorithm);
}

std::string_view NameOf(Grouping grouping) {
  switch (grouping) {
    case Grouping::kWidePacket:
      return "wide packet";
    case Grouping::kStream:
      return "stream";
    default:
      return "wide";
  }
}

std::span<const Variant> AllKernels() {
  static const std::vector<Variant> kernels = MakeAll();
  return kernels;
}

}  // namespace quarry
