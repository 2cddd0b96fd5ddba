#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>

#include "common/base/status.h"
#include "common/scene/view.h"
#include "common/voxel/part_tree.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// Resolves the lists of views to selections, for one scene. Reads the scene's parts when a list is first
/// resolved, and keeps them; the places of attributes likewise. Not thread-safe: used on the io_context's
/// thread. Memory: that of PartTree and PartAttributes once they are needed, and kMostKept selections.
class PartSelections {
 public:
  /// Limit of selections that are kept, beside those of views in use. A judgement: a viewer goes back through
  /// its last steps.
  static constexpr size_t kMostKept = 32;

  /// `store` must outlive this.
  explicit PartSelections(const StoreReader& store) : store_(store) {}

  /// The scene's parts. Errors: they cannot be read.
  Result<std::shared_ptr<const PartTree>> Parts();

  /// The attributes of a part, a JSON object; empty: it has none. Errors: they cannot be read.
  Result<std::string> AttributesOf(uint32_t part);

  /// Sets the view's selection: of its lists, with the closed parts if its section has caps. A view that
  /// needs none keeps none. Errors: a path names no part (the sentence has the nearest one); parts
  /// cannot be read.
  Status Complete(View& view);

  /// A kept selection without caps by its id, with its lists. Null: it is not kept.
  std::shared_ptr<const PartLists> Find(uint64_t id) const;

  /// The box of the parts that a selection shows, scene units, and the number of the others.
  struct Extent {
    glm::vec3 lower, upper;
    uint64_t hidden = 0;
  };
  Result<Extent> ExtentOf(const PartSelection* selection);

 private:
  struct Kept {
    std::shared_ptr<const PartLists> lists;  ///< null: all parts
    bool caps;
    std::shared_ptr<const PartSelection> selection;
  };
  Result<std::shared_ptr<const PartSelection>> Resolve(const PartLists* lists, bool caps);

  const StoreReader& store_;
  std::shared_ptr<const PartTree> parts_;
  std::optional<PartAttributes> attributes_;
  std::deque<Kept> kept_;  ///< the newest first
};

}  // namespace quarry
