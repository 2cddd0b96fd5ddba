#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/net/connection.h"

namespace quarry {

/// A job of Slurm that runs deploy/slurm/quarry.sbatch. Used by one thread; asks Slurm's own commands.
struct SlurmJob {
  std::string id, log;
  bool is_array = false;
};

/// The options, environment and arguments of a job.
struct SlurmSubmission {
  std::vector<std::string> options;                              ///< of sbatch
  std::vector<std::pair<std::string, std::string>> environment;  ///< variables that the script reads
  std::vector<std::string> arguments;                            ///< of the script
  bool is_array = false;
};

/// Errors: there is no Slurm; it refuses the job, in its own words.
Result<SlurmJob> SubmitJob(const SlurmSubmission& submission);

/// Waits until the job runs, or for a job array until a task does, and tells why it waits. Returns: the
/// master's address; none for an array, or when the job is done already.
/// Errors: the job has failed at its start, in its own sentence; Slurm would never start it, and it is
/// cancelled; Slurm does not answer.
Result<std::optional<Endpoint>> AwaitStart(const SlurmJob& job);

/// Ends a job, or a task of an array ("12_3"), waits until it is gone, and removes the files that it has left
/// in its folder. Errors (usage): no number of a job. Errors: no such job; one of another program; Slurm does
/// not answer.
Status StopJob(const std::string& id);

}  // namespace quarry
