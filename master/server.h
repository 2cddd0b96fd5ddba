#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/net/connection.h"
#include "common/voxel/store_reader.h"
#include "master/schedule/scheduler.h"

namespace quarry {

struct MasterOptions {
  std::string scene;
  Endpoint listen{"127.0.0.1", 0};
  bool serve_only = false;           ///< voxels only: no workers, no jobs
  std::vector<std::string> sources;  ///< where workers get voxels, as ParseSource has them; empty: here
  SchedulingPolicy policy = SchedulingPolicy::kFootprint;
  std::string spool;                      ///< folder that keeps jobs and finished frames; empty: none is kept
  uint64_t foresight_bytes = 256u << 20;  ///< of a cache for foreseeing what tiles touch; 0: none is kept
  uint64_t frame_memory = 4u << 30;       ///< bytes of pictures under way and of jobs
  std::string trace;                      ///< file for what each tile touched and cost; empty: none
  Security security;                      ///< of every connection
  bool quiet = false;
};

/// Serves one scene: its catalog and voxels to workers, jobs from clients, tiles to workers. Returns only
/// with an error (the store cannot be opened, the port is in use); a signal ends it otherwise. Once it
/// listens it prints "listening HOST:PORT" on standard output.
Status RunMaster(const MasterOptions& options);

}  // namespace quarry
