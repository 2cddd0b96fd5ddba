#pragma once

#include "common/base/status.h"
#include "deploy/command/render_options.h"

namespace quarry {

/// Renders to `output`, or to `out.####.png` for several frames. Starts a cluster on this machine, or uses
/// the master of --master. A model is preprocessed first; its store is kept and reused while the model is
/// unchanged (see StoreFor()). Without a scene, the master's is rendered.
/// Errors: as StoreFor() and RenderRemotely(); (usage) arguments that contradict each other or have no
/// effect; an output that OutputGuard refuses.
Status Render(RenderArguments arguments);

/// All that Render() checks before it starts anything, of a store. Returns: the job. Errors: as Render().
Result<RenderJob> CheckedJob(RenderArguments arguments);

}  // namespace quarry
