#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of `quarry cluster`, as given.
struct ClusterArguments {
  bool slurm = false, print = false, no_wait = false;
  unsigned nodes = 1, tasks = 0, threads = 0;  ///< 0: no job array; by Slurm's allocation
  std::string time, partition, cache, http, secret_file, scene, stop;
  std::vector<std::string> sbatch;  ///< further options of sbatch
  std::vector<std::string> render;  ///< the arguments of `quarry render`, without a scene
};

/// Adds the options of `quarry cluster`, which are parsed into `arguments`. Both must outlive the parsing.
void AddClusterCommandOptions(CLI::App& command, ClusterArguments& arguments);

/// Submits a cluster as a Slurm job (deploy/slurm/quarry.sbatch) and waits until it runs; prints that script
/// with the command that submits it; or ends such a job and waits until it is gone.
/// Errors (usage): arguments that `quarry render` would refuse, or that mean nothing to a job. Errors: there
/// is no Slurm; Slurm refuses the job, or can never start it; the job's own sentence when it fails at its
/// start. No job stays behind an error.
Status RunClusterCommand(const ClusterArguments& arguments);

}  // namespace quarry
