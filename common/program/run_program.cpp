#include "common/program/run_program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <exception>
#include <new>
#include <string>
#include <system_error>

#include "common/base/cleanup.h"
#include "common/base/log.h"
#include "common/program/cpu_check.h"

namespace quarry {
namespace {

const char* program_name = "quarry";

/// Opens /dev/null for each of the descriptors 0 to 2 that is closed, input for writing and output for
/// reading: using it is still an error, as with a closed descriptor. Standard error can be written, for
/// libraries that write there.
void OpenStandardDescriptors() {
  constexpr int kModes[] = {O_WRONLY, O_RDONLY, O_WRONLY};
  for (int fd = 0; fd < 3; ++fd)
    if (::fcntl(fd, F_GETFD) < 0) (void)::open("/dev/null", kModes[fd]);  // takes the lowest number, `fd`
}

/// The sentence of the exception that is being handled. `known`: whether a limit of the machine caused it,
/// rather than an error of Quarry's own.
std::string ExceptionText(bool& known) {
  known = true;
  try {
    throw;
  } catch (const std::bad_alloc&) {
    return "memory ran out: the system gives no more (ulimit -v, or the limit of a cgroup or job)";
  } catch (const std::system_error& e) {
    if (e.code() == std::errc::resource_unavailable_try_again)
      return "the system refuses another thread (ulimit -u, ulimit -v, or pids.max of a cgroup)";
    known = false;
    return fmt::format("ended by an unexpected error: {}", e.what());
  } catch (const std::exception& e) {
    known = false;
    return fmt::format("ended by an unexpected error: {}", e.what());
  } catch (...) {
    known = false;
    return "ended by an unexpected error";
  }
}

/// The last resort: an exception that no thread has caught.
[[noreturn]] void OnTerminate() {
  bool known = false;
  if (std::current_exception()) Log(std::string(program_name) + ": " + ExceptionText(known));
  if (known) EndAtOnce(1);
  std::abort();
}

}  // namespace

int ExitStatus(const Status& status) {
  if (status) return 0;
  // One sentence, whatever ends of lines the names in it have.
  if (!status.error().message.empty())
    Log(std::string(program_name) + ": " + PrintableName(status.error().message));
  return status.error().exit_status();
}

int RunProgram(const ProgramFacts& program, int argc, char** argv, int (*body)(int argc, char** argv)) {
  RequireCpu();
  OpenStandardDescriptors();
  program_name = program.name;
  std::set_terminate(OnTerminate);
  InstallSignalHandlers(program.name, program.kept);
  EndWithParent();
  int status = 1;
  try {
    status = body(argc, argv);
  } catch (...) {
    bool known = false;
    (void)ExitStatus(Fail(ExceptionText(known)));
  }
  const int of_output = ExitStatus(FinishOutput());
  return status == 0 ? of_output : status;
}

}  // namespace quarry
