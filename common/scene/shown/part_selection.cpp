#include "common/scene/shown/part_selection.h"

#include <span>

#include "common/base/bytes.h"
#include "common/math/random.h"

namespace quarry {

uint64_t IdOf(const PartSelection& selection) {
  uint64_t id = 0;
  const auto add = [&](const auto& values) {
    id = Mix64(id + values.size() + 1) ^ Checksum(std::as_bytes(std::span(values)));
  };
  add(selection.hidden);
  add(selection.voxels);
  add(selection.closed);
  add(selection.inverted);
  add(selection.colors);
  add(selection.color_of);
  return id != 0 ? id : 1;
}

}  // namespace quarry
