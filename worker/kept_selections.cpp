#include "worker/kept_selections.h"

#include <utility>

#include "common/engine/surfaces/shown_parts.h"
#include "common/protocol/messages.h"

namespace quarry {

Status KeptSelections::Take(std::span<const std::byte> table, const Catalog& catalog) {
  QUARRY_ASSIGN(SelectionSetup selection, DecodeSelection(table));
  if (!FitsScene(selection, catalog) || IdOf(selection) != selection.id)
    return Fail("the master sent a selection of parts that does not fit the scene");
  kept_.push_back(std::make_shared<const PartSelection>(std::move(selection)));
  if (kept_.size() > kMostSelections) kept_.pop_front();
  return {};
}

Result<std::shared_ptr<const PartSelection>> KeptSelections::Find(uint64_t id) const {
  if (id == 0) return nullptr;
  for (const auto& selection : kept_)
    if (selection->id == id) return selection;
  return Fail("the master named a selection of parts that it has not sent");
}

}  // namespace quarry
