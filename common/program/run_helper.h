#pragma once

#include <cstdint>

#include "common/program/run_program.h"

namespace quarry {

/// The body of a helper, "quarry-import-X BYTES", which reads requests from standard input. Text that
/// libraries print is dropped: `serve` gets the descriptor of standard output under another number. malloc
/// keeps one arena, since each takes 128 MB of address space. Returns: the exit status, 2 for other
/// arguments.
int HelperBody(int argc, char** argv, int (*serve)(uint64_t memory, int out));

/// Runs a helper of quarry-preprocess: a process of its own for data that strangers made, since libraries
/// hold it whole and may crash. `Serve(memory, out)` answers on `out` and returns the exit status; it limits
/// its address space to its own and `memory` bytes (LimitAddressSpace()). Requires: called once, by main.
template <int (*Serve)(uint64_t memory, int out)>
int RunHelper(const char* name, int argc, char** argv) {
  return RunProgram({name, "nothing was written"}, argc, argv,
                    [](int count, char** words) { return HelperBody(count, words, Serve); });
}

}  // namespace quarry
