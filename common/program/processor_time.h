#pragma once

#include <sys/resource.h>

namespace quarry {

/// Limits the processor time of this process from now on; SIGXCPU then ends it. A decoder in an endless loop
/// must not block a run.
/// Errors: none are reported.
void LimitProcessorTime(rlim_t seconds);

}  // namespace quarry
