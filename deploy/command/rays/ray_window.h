#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/api/quarry.h"
#include "common/scene/ray_query.h"
#include "deploy/command/rays/npy.h"

namespace quarry {

/// A window of an input's rays, in an order in which neighbours meet the same voxels. Not thread-safe.
class RayWindow {
 public:
  /// Takes the next rays. `name`: of the input, for messages. Errors (usage): a ray that cannot be (the
  /// sentence names its row and byte). Else as NpyReader::Read().
  Status Read(NpyReader& input, const std::string& name, uint64_t first_row, uint64_t rows);
  size_t size() const { return order_.size(); }
  /// The number in the window of the sorted ray `i`.
  size_t PlaceOf(size_t i) const { return order_[i]; }
  /// A window of its rays from number `first` on.
  RayWindow Part(size_t first, size_t count) const;
  /// The sorted rays. Valid while the window is.
  quarry_rays Sorted(uint32_t flags) const;

 private:
  RayQuery QueryOf(size_t i) const;
  void Sort(size_t rows);

  size_t columns_ = 6;
  std::vector<double> given_, sorted_;
  std::vector<uint32_t> order_;
};

}  // namespace quarry
