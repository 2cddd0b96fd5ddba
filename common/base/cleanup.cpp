#include "common/base/cleanup.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace quarry {
namespace {

constexpr int kSlots = 32;           // paths registered at once; further paths are not registered
constexpr size_t kPathBytes = 4096;  // PATH_MAX of Linux

// Plain arrays: a signal handler must neither allocate nor lock.
char paths[kSlots][kPathBytes];
enum State : int { kFree, kFilling, kFile, kFolder };
std::atomic<int> states[kSlots];
constexpr size_t kMessageBytes = 2 * kPathBytes;
char messages[2][kMessageBytes];
std::atomic<int> message{0};
std::string program_name;

struct Left {
  char path[kPathBytes];
  char text[2 * kPathBytes];
  std::atomic<bool> used;
};
Left lefts[2];

// Both are sequentially consistent: either the thread that constructs a SignalsHeld sees `pending`, or the
// handler sees that `held` is not 0. The thread that sees the other's value calls End().
std::atomic<int> held{0};
std::atomic<bool> pending{false}, ending{false};
std::atomic<int> on_termination{-1};        // takes the first SIGTERM
std::atomic<int64_t> terminated_ns{-1};     // when it came
constexpr int64_t kTogetherNs = 500000000;  // SIGTERMs so soon after it are the same request
thread_local int depth = 0;                 // SignalsHeld objects in this thread

// Time that threads still creating files are given: 50 rounds of 1 ms.
constexpr int kRounds = 50, kRoundMs = 1;

/// Removes the files in a folder. Uses the system call itself: opendir() allocates.
void EmptyFolder(const char* path) {
  const int fd = ::open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0) return;
  struct Entry {
    uint64_t inode;
    int64_t next;
    uint16_t size;
    uint8_t type;
    char name[1];
  };
  alignas(Entry) char buffer[4096];
  for (;;) {
    const long n = ::syscall(SYS_getdents64, fd, buffer, sizeof buffer);
    if (n <= 0) break;
    for (long at = 0; at < n;) {
      const auto* entry = reinterpret_cast<const Entry*>(buffer + at);
      ::unlinkat(fd, entry->name, 0);  // fails for folders, which stay
      at += entry->size;
    }
  }
  ::close(fd);
}

void RemoveAll() {
  // Other threads still run and may create files: a folder that is not empty is tried again.
  bool again = true;
  for (int round = 0; again && round < kRounds; ++round) {
    if (round > 0) ::poll(nullptr, 0, kRoundMs);
    again = false;
    for (int i = 0; i < kSlots; ++i) {
      if (states[i].load() == kFile) ::unlink(paths[i]);
      if (states[i].load() == kFolder) EmptyFolder(paths[i]);
    }
    for (int i = 0; i < kSlots; ++i)
      if (states[i].load() >= kFile && ::rmdir(paths[i]) != 0 && (errno == ENOTEMPTY || errno == EEXIST))
        again = true;
  }
}

[[noreturn]] void Wait() {
  for (;;) ::pause();
}

[[noreturn]] void End() {
  // The thread that ends the program must not be interrupted by another signal: it would wait for itself. A
  // signal that arrives before the mask is set ends the program in this thread's place.
  sigset_t all;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_BLOCK, &all, nullptr);
  if (ending.exchange(true)) Wait();
  RemoveAll();
  const char* text = messages[message.load()];
  for (const Left& left : lefts)
    if (left.used.load() && ::access(left.path, F_OK) == 0) {
      text = left.text;
      break;
    }
  (void)!::write(2, text, std::strlen(text));
  ::_exit(1);
}

int64_t NowNs() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return int64_t{now.tv_sec} * 1000000000 + now.tv_nsec;
}

/// Whether a SIGTERM is a request that ends nothing.
bool IsTaken() {
  if (const int taker = on_termination.exchange(-1); taker >= 0) {
    terminated_ns.store(NowNs());
    const int before = errno;
    constexpr uint64_t kOne = 1;
    (void)!::write(taker, &kOne, sizeof kOne);
    errno = before;
    return true;
  }
  const int64_t first = terminated_ns.load();
  return first >= 0 && NowNs() - first < kTogetherNs;
}

void OnSignal(int signal) {
  if (signal == SIGTERM && IsTaken()) return;
  pending.store(true);
  if (held.load() == 0) End();
}

/// The line on standard error when a signal ends the program.
std::string Line(const std::string& text) { return "\n" + program_name + ": interrupted; " + text + "\n"; }

int Name(const std::string& path, State state) {
  if (path.size() >= kPathBytes) return -1;
  for (int i = 0; i < kSlots; ++i) {
    int free = kFree;
    if (!states[i].compare_exchange_strong(free, kFilling)) continue;
    std::memcpy(paths[i], path.c_str(), path.size() + 1);
    states[i].store(state);
    return i;
  }
  return -1;
}

}  // namespace

int RemoveOnSignal(const std::string& path) { return Name(path, kFile); }
int RemoveFolderOnSignal(const std::string& path) { return Name(path, kFolder); }

void Forget(int handle) {
  if (handle >= 0) states[handle].store(kFree);
}

SignalsHeld::SignalsHeld() {
  if (depth++ > 0) return;
  held.fetch_add(1);
  if (!pending.load()) return;
  if (held.fetch_sub(1) == 1) End();
  Wait();  // the last thread that holds signals ends the program
}

SignalsHeld::~SignalsHeld() {
  if (--depth > 0) return;
  if (held.fetch_sub(1) == 1 && pending.load()) End();
}

void ReportIfLeft(const std::string& path, const std::string& left) {
  const std::string text = Line(left);
  for (Left& l : lefts) {
    if (l.used.load() || path.size() >= sizeof l.path || text.size() >= sizeof l.text) continue;
    std::memcpy(l.path, path.c_str(), path.size() + 1);
    std::memcpy(l.text, text.c_str(), text.size() + 1);
    l.used.store(true);
    return;
  }
}

void InstallSignalHandlers(const std::string& program, const std::string& kept) {
  program_name = program;
  PrintOnSignal(kept);
  struct sigaction action {};
  action.sa_handler = OnSignal;
  for (int signal : {SIGINT, SIGTERM}) ::sigaction(signal, &action, nullptr);
  struct sigaction before {};
  if (::sigaction(SIGHUP, nullptr, &before) == 0 && before.sa_handler != SIG_IGN)  // nohup ignores it
    ::sigaction(SIGHUP, &action, nullptr);
  // Handlers that do nothing, not SIG_IGN: programs that this one starts would inherit that.
  action.sa_handler = [](int) {};
  action.sa_flags = SA_RESTART;
  for (int signal : {SIGPIPE, SIGXFSZ}) ::sigaction(signal, &action, nullptr);
}

int AwaitTermination() {
  const int descriptor = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  on_termination.store(descriptor);
  return descriptor;
}

void AwaitTerminationNoMore() {
  on_termination.store(-1);
  terminated_ns.store(-1);
}

void EndAtOnce(int status) {
  RemoveAll();
  ::_exit(status);
}

void PrintOnSignal(const std::string& kept) {
  const std::string text = Line(kept);
  const int next = 1 - message.load();
  std::strncpy(messages[next], text.c_str(), kMessageBytes - 1);
  message.store(next);
}

void EndWithParent() {
  const char* parent = std::getenv("QUARRY_PARENT");
  if (!parent) return;
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != std::atoi(parent)) ::_exit(1);  // the parent died before prctl() took effect
}

}  // namespace quarry
