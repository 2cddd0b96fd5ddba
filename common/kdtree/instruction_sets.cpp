#include "common/kdtree/instruction_sets.h"

#include <algorithm>
#include <vector>

#include "common/kdtree/kernels.h"

namespace quarry {

std::span<const std::string_view> InstructionSets() {
  static const std::vector<std::string_view> sets = [] {
    std::vector<std::string_view> found;
    for (const Kernel& kernel : Kernels())
      if (std::ranges::find(found, kernel.isa) == found.end()) found.push_back(kernel.isa);
    return found;
  }();
  return sets;
}

}  // namespace quarry
