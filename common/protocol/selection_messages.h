#pragma once

#include <cstddef>
#include <memory>

#include "common/base/status.h"
#include "common/scene/shown/part_selection.h"
#include "common/scene/shown/section_cut.h"
#include "messages_generated.h"

// The tables of views that hide parts or cut the model, for encoders and decoders of messages alone.

namespace quarry {

/// Null for a view without a section.
std::unique_ptr<wire::SectionT> SectionToWire(const SectionCut& section);
/// Reads and normalizes a section; none where `w` is null. Errors: not well formed; NormalizeSection().
Status ReadSection(const wire::Section* w, SectionCut& section);

/// Null for a view without lists.
std::unique_ptr<wire::PartListsT> PartListsToWire(const PartLists* lists);
/// Errors: not well formed, or texts that share bytes.
Result<std::shared_ptr<const PartLists>> ReadPartLists(const wire::PartLists& w, size_t message_bytes);

}  // namespace quarry
