#pragma once

#include <string>

namespace quarry {

/// Registers a temporary file for removal when a signal ends the program. `path` may also be a folder that is
/// empty by then.
/// Returns: a handle for Forget(), or -1 when 32 paths are registered or the path exceeds 4,095 bytes; a
/// signal then leaves the file. Thread-safe.
int RemoveOnSignal(const std::string& path);
/// Registers a folder and the files directly in it for removal. Folders inside it stay, and then so does the
/// folder.
int RemoveFolderOnSignal(const std::string& path);
/// Ends a registration: the file is removed already or has its final name. Ignores -1. Thread-safe.
void Forget(int handle);

/// Delays the end of the program by a signal while it lives. The owner creates files and registers them with
/// RemoveOnSignal(), or calls Forget(), with no signal in between.
/// Requires: a short scope that never blocks. Thread-safe; may be nested.
class SignalsHeld {
 public:
  SignalsHeld();
  ~SignalsHeld();
  SignalsHeld(const SignalsHeld&) = delete;
};

/// Sets the line that a signal prints when `path` still exists after the removals: `left` replaces the text
/// of InstallSignalHandlers(). The check is made on the disk, so the line is true whenever the signal comes.
/// Holds two paths, checked in the order of registration; further paths are ignored.
void ReportIfLeft(const std::string& path, const std::string& left);

/// Makes SIGINT, SIGTERM and SIGHUP remove the registered files, print "PROGRAM: interrupted; KEPT" on
/// standard error and exit with status 1. `kept`: a sentence about the results that the interruption keeps.
/// SIGHUP stays ignored where it is (nohup). SIGPIPE and SIGXFSZ do nothing: writes report the error.
void InstallSignalHandlers(const std::string& program, const std::string& kept);

/// Makes the first SIGTERM a request: the program continues, and the returned descriptor becomes readable. A
/// SIGTERM at least half a second later ends the program as with InstallSignalHandlers(). Earlier ones are
/// ignored: a program that ends a group of processes may send several at once. Requires: one call, after
/// InstallSignalHandlers(). Returns: -1 when the process can open no descriptor; then each SIGTERM ends the
/// program.
int AwaitTermination();
/// From now on each SIGTERM ends the program.
void AwaitTerminationNoMore();

/// Removes the registered files and folders, and ends the process at once, without destructors.
[[noreturn]] void EndAtOnce(int status);

/// Replaces the text `kept` of InstallSignalHandlers(). Requires: only few calls, and one thread that calls.
void PrintOnSignal(const std::string& kept);

/// Ties this process to its parent when the environment's QUARRY_PARENT holds the parent's process id: the
/// system then sends SIGTERM when the parent dies in any way. Does nothing without QUARRY_PARENT.
void EndWithParent();

}  // namespace quarry
