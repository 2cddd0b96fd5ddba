#include "common/scene/render_mode.h"

#include <algorithm>

namespace quarry {

const RenderModeInfo& InfoOf(RenderMode mode) {
  return *std::ranges::find(kRenderModeInfo, mode, &RenderModeInfo::mode);
}

std::optional<RenderMode> FindRenderMode(std::string_view name) {
  for (const RenderModeInfo& info : kRenderModeInfo)
    if (name == info.name) return info.mode;
  return std::nullopt;
}

std::vector<std::string> RenderModeNames() {
  std::vector<std::string> names;
  for (const RenderModeInfo& info : kRenderModeInfo) names.emplace_back(info.name);
  return names;
}

}  // namespace quarry
