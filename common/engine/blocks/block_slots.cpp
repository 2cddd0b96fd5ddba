#include "common/engine/blocks/block_slots.h"

#include <fmt/format.h>

#include "common/base/size.h"

namespace quarry {

Result<EnvironmentPages> BlockSlots::AddEnvironment(const Catalog& environment) {
  if (const auto known = FindEnvironment(environment.id)) return *known;
  if (environment.meta.largest_decoded > most_bytes_)
    return BadUsage(fmt::format("--cache of {} is less than a page of the environment, {} bytes",
                                FormatSize(most_bytes_), environment.meta.largest_decoded));
  const std::lock_guard lock(mutex_);
  if (count_ == kMostEnvironments)
    return BadUsage(fmt::format("more than {} environments", kMostEnvironments));
  environments_[count_] = {&environment, std::make_unique<Slot[]>(environment.first_page.back())};
  return EnvironmentPages{&environment, count_++};
}

std::optional<EnvironmentPages> BlockSlots::FindEnvironment(const SceneId& id) const {
  const std::lock_guard lock(mutex_);
  for (uint32_t number = 0; number < count_; ++number)
    if (environments_[number].catalog->id == id)
      return EnvironmentPages{environments_[number].catalog, number};
  return {};
}

}  // namespace quarry
