#pragma once

#include "common/base/status.h"

namespace quarry {

/// A program's name and its words on interruption, for RunProgram().
struct ProgramFacts {
  const char* name;  ///< "quarry-worker", before each of its errors
  const char* kept;  ///< results that an interruption keeps; see InstallSignalHandlers()
};

/// Runs a program: `body(argc, argv)` between one start and one end.
/// Start: ends on a processor that cannot run Quarry; opens /dev/null for each of the descriptors 0 to 2 that
/// is closed, so that no file gets their numbers; handles signals (InstallSignalHandlers(), EndWithParent()).
/// End: an exception that the body lets through becomes a sentence and status 1, in other threads too;
/// standard output that could not be written makes status 1 of status 0.
/// Returns: the exit status. Requires: called once, by main.
int RunProgram(const ProgramFacts& program, int argc, char** argv, int (*body)(int argc, char** argv));

/// Logs an error, behind the program's name, and returns the exit status to end with. An error without a
/// message has already been reported.
int ExitStatus(const Status& status);

}  // namespace quarry
