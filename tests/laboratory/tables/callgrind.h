#pragma once

#include <cstdint>
#include <istream>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"

// Instructions of named functions, counted by callgrind. These are our counterpart of the instruction counts
// of Purcell et al. 2002, table 1. Under valgrind programs see a processor without AVX-512.

namespace quarry::laboratory {

/// The cost of all calls of a function.
struct FunctionCost {
  uint64_t calls = 0;
  uint64_t instructions = 0;  ///< machine instructions, including the functions that it calls
};

/// Costs by the names asked for.
using FunctionCosts = std::map<std::string, FunctionCost>;

/// Tells if valgrind is on this machine's PATH.
bool ValgrindInstalled();
/// Why instructions of Quarry's programs cannot be counted on this machine: valgrind is not installed; or the
/// processor lacks RDTSCP, which libhwy executes at start since valgrind says that it is there. Empty: they
/// can be counted.
std::string WhyNotCounted();

/// Runs `command` (the program and its arguments; no shell) under callgrind, without its output, and counts.
/// A name of `functions` means the functions of exactly this demangled name, or if there is none, all whose
/// names contain it; the costs of several are added, so that none of them may call another. A function that
/// was inlined or never called has the cost 0. Recursive functions are not supported: their inclusive cost
/// counts inner calls again.
/// `at_request`: counts only after the program asks for it (CALLGRIND_START_INSTRUMENTATION); the part before
/// runs much faster.
/// Requires: `command` is not empty. Blocks until the program has ended, about 50 times its own time.
/// Thread-safe. Errors: valgrind is not installed, the program fails, its profile is not understood; one
/// sentence each.
Result<FunctionCosts> CountInstructions(const std::vector<std::string>& command,
                                        std::span<const std::string> functions, bool at_request = false);

/// Reads a profile in callgrind's format, as CountInstructions() asks for it: of one event, without
/// compressed names and without relative positions. Source: "Callgrind Format Specification", version 1, of
/// the valgrind manual. `name`: the profile's name in errors. Errors: instructions that do not add up to the
/// profile's own total.
Result<FunctionCosts> ReadCallgrindProfile(std::istream& profile, const std::string& name,
                                           std::span<const std::string> functions);

}  // namespace quarry::laboratory
