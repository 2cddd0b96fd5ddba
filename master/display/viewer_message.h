#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <variant>

#include "common/base/status.h"
#include "common/scene/ray_query.h"
#include "common/scene/render_job.h"
#include "common/scene/view_json.h"
#include "master/display/view_pacer.h"

namespace quarry {

/// Limit of a view's side in pixels: that of a browser's canvas.
inline constexpr uint32_t kMostSide = 16384;

/// Limit of a message's bytes: lists of parts may be long.
inline constexpr size_t kMostMessageBytes = 1u << 20;

/// The messages of a browser. See PROTOCOL.md.
struct AckMessage {
  uint64_t frame = 0;
};
struct PickMessage {
  uint64_t pick = 0;
  double x = 0, y = 0;          ///< pixels of the view last sent
  std::optional<RayQuery> ray;  ///< instead of a pixel; its direction has length 1
};
struct SettingsMessage {
  std::optional<double> frame_rate;
  std::optional<int> quality;  ///< of JPEG
  std::optional<uint32_t> step;
  std::optional<bool> wait, owners;
};
/// A request to render a picture of any size as a job; without a job the pending one is cancelled.
struct SaveMessage {
  uint64_t save = 0;
  std::optional<RenderJob> job;
};
/// The parts that later views show: they name it by the id in the answer.
struct SelectMessage {
  std::shared_ptr<const PartLists> lists;  ///< null: all parts as they are
};
using ViewerMessage =
    std::variant<WantedView, AckMessage, PickMessage, SettingsMessage, SaveMessage, SelectMessage>;

/// Finds the lists of a selection by its id. Null: it is not known.
using FindLists = std::function<std::shared_ptr<const PartLists>(uint64_t id)>;

/// Reads a browser's message. `defaults`: members of views that are missing. `offset`: SceneMeta::offset.
/// `most_pixels`: of a view. `find`: for views that name a selection. Views come out normalized. Errors: a
/// sentence for the viewer. Thread-safe as `find` is.
Result<ViewerMessage> ReadViewerMessage(std::string_view text, const ViewDescription& defaults,
                                        const glm::dvec3& offset, uint64_t most_pixels,
                                        const FindLists& find = {});

}  // namespace quarry
