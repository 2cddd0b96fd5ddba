#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "tests/laboratory/machine/study.h"

namespace quarry::laboratory {

/// Callgrind's counts of one run of the multipass machine.
struct InstructionCount {
  Instructions instructions;
  uint64_t all = 0;  ///< instructions of all kernels together
};

/// Runs `command`, a program that runs the multipass machine with PlainMemory between
/// StartCountingInstructions() and StopCountingInstructions(), under callgrind, and finds the instructions of
/// its kernels: the scalar instance, on this processor's instruction set. Kernels that did not run have 0.
/// Errors: as CountInstructions(); no kernel has run.
Result<InstructionCount> CountKernelInstructions(const std::vector<std::string>& command);

/// Under callgrind with --instr-atstart=no: counts from here on. Else does nothing.
void StartCountingInstructions();
void StopCountingInstructions();

}  // namespace quarry::laboratory
