#include "common/base/cleanup.h"

#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace quarry {
namespace {

constexpr int kSlots = 32;
constexpr size_t kPathBytes = 4096;

// Plain arrays: a signal handler may touch nothing that allocates or locks.
char paths[kSlots][kPathBytes];
std::atomic<int> states[kSlots];  // 0 free, 1 being filled, 2 in use
constexpr size_t kMessageBytes = 2 * kPathBytes;
char messages[2][kMessageBytes];
std::atomic<int> message{0};
std::string program_name;

void OnSignal(int) {
  // Other threads run on and may make a file meanwhile: a folder that is not empty is tried again.
  bool again = true;
  for (int round = 0; again && round < 1000; ++round) {
    again = false;
    for (int i = 0; i < kSlots; ++i)
      if (states[i].load() == 2) ::unlink(paths[i]);
    for (int i = 0; i < kSlots; ++i)
      if (states[i].load() == 2 && ::rmdir(paths[i]) != 0 && (errno == ENOTEMPTY || errno == EEXIST))
        again = true;
  }
  const char* text = messages[message.load()];
  (void)!::write(2, text, std::strlen(text));
  ::_exit(1);
}

}  // namespace

int RemoveOnSignal(const std::string& path) {
  if (path.size() >= kPathBytes) return -1;
  for (int i = 0; i < kSlots; ++i) {
    int free = 0;
    if (!states[i].compare_exchange_strong(free, 1)) continue;
    std::memcpy(paths[i], path.c_str(), path.size() + 1);
    states[i].store(2);
    return i;
  }
  return -1;
}

void Forget(int handle) {
  if (handle >= 0) states[handle].store(0);
}

void InstallSignalHandlers(const std::string& program, const std::string& kept) {
  program_name = program;
  TellOnSignal(kept);
  struct sigaction action {};
  action.sa_handler = OnSignal;
  for (int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
}

void TellOnSignal(const std::string& kept) {
  const std::string text = "\n" + program_name + ": interrupted; " + kept + "\n";
  const int next = 1 - message.load();
  std::strncpy(messages[next], text.c_str(), kMessageBytes - 1);
  message.store(next);
}

void EndWithParent() {
  const char* parent = std::getenv("QUARRY_PARENT");
  if (!parent) return;
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != std::atoi(parent)) ::_exit(1);  // it died before the line above
}

}  // namespace quarry
