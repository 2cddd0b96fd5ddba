#pragma once

#include <string_view>

namespace quarry {

/// The text of deploy/slurm/quarry.sbatch.
extern const std::string_view kSlurmScript;

}  // namespace quarry
