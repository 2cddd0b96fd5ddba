// Preloaded before libfaketime, which shifts the deadlines of timers of the monotonic clock too, even where
// it is told to leave that clock alone: with the time of day in another year, a timer that is due at once
// never fires. Real clocks have no such fault.
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <unistd.h>

extern "C" int timerfd_settime(int timer, int flags, const itimerspec* value, itimerspec* old) noexcept {
  return static_cast<int>(::syscall(SYS_timerfd_settime, timer, flags, value, old));
}
