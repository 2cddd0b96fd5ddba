#include "common/base/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace quarry {

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(::isatty(2) != 0) {}

void Progress::Begin(std::string phase) {
  End();
  phase_ = std::move(phase);
  begun_ = shown_ = Clock::now();
  tenth_ = -1;
}

void Progress::Update(uint64_t done, uint64_t total) {
  if (quiet_ || total == 0) return;
  const auto now = Clock::now();
  const double fraction = static_cast<double>(done) / static_cast<double>(total);
  const double elapsed = std::chrono::duration<double>(now - begun_).count();
  const double left = fraction > 0 ? elapsed * (1 - fraction) / fraction : 0;
  if (terminal_) {
    if (done < total && now - shown_ < std::chrono::milliseconds(200)) return;
    shown_ = now;
    fmt::print(stderr, "\r{}: {:3.0f} %, about {:.0f} s left \033[K", phase_, fraction * 100, left);
    open_ = true;
  } else if (const int tenth = static_cast<int>(fraction * 10); tenth > tenth_) {
    tenth_ = tenth;
    fmt::print(stderr, "{}: {} %, about {:.0f} s left\n", phase_, tenth * 10, left);
  }
}

void Progress::End() {
  if (open_) fmt::print(stderr, "\r{}: done \033[K\n", phase_);
  open_ = false;
}

void Progress::Say(const std::string& text) {
  if (quiet_) return;
  if (open_) fmt::print(stderr, "\r\033[K");
  fmt::print(stderr, "{}\n", text);
}

}  // namespace quarry
