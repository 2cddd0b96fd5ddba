#pragma once

#include <string>

namespace quarry {

/// Names a temporary file, or a folder that will be empty by then, to be removed should a signal end the
/// program. Returns a handle for Forget; -1 when all slots are taken (then only normal ends remove it).
/// Thread-safe.
int RemoveOnSignal(const std::string& path);
/// The same of a folder with whatever files are in it; folders in it stay, and it with them.
int RemoveFolderOnSignal(const std::string& path);
/// The file is gone or has its final name. Handles of -1 are ignored.
void Forget(int handle);

/// While one lives, a signal does not end the program yet: what is made meanwhile is also named to
/// RemoveOnSignal, or forgotten whole. Short: between its ends nothing waits. Thread-safe; may be nested.
class SignalsHeld {
 public:
  SignalsHeld();
  ~SignalsHeld();
  SignalsHeld(const SignalsHeld&) = delete;
};

/// Should `path` still be there after a signal has removed what it is to remove, its line says `left` instead
/// of what is kept: the disk decides what is said, whatever the moment. Two paths at most, the first named
/// goes first; more are ignored.
void TellIfLeft(const std::string& path, const std::string& left);

/// On SIGINT, SIGTERM and SIGHUP: removes what RemoveOnSignal named, prints "PROGRAM: interrupted; " and
/// `kept` (what is kept) on standard error, and ends with status 1. SIGPIPE is ignored: writes report it.
void InstallSignalHandlers(const std::string& program, const std::string& kept);

/// From now on a signal's line says that `kept` is kept. A program may call it a few times.
void TellOnSignal(const std::string& kept);

/// Called by a program that another one may have started for itself alone (environment QUARRY_PARENT set to
/// that one's process id): it is ended by the system when that one dies, however it dies.
void EndWithParent();

}  // namespace quarry
