#include "common/base/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace quarry {

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(::isatty(2) != 0) {}

void Progress::Begin(std::string phase, std::string unit) {
  End();
  phase_ = std::move(phase);
  unit_ = std::move(unit);
  begun_ = shown_ = Clock::now();
  tenth_ = -1;
}

std::string Progress::Details(uint64_t done, uint64_t total) const {
  // Of less than this neither rate nor estimate means much.
  constexpr double kLeastSeconds = 0.5, kLeastFraction = 0.005;
  const double elapsed = std::chrono::duration<double>(Clock::now() - begun_).count();
  const double fraction = static_cast<double>(done) / static_cast<double>(total);
  if (elapsed < kLeastSeconds || fraction < kLeastFraction) return "";
  std::string text;
  if (!unit_.empty())
    text = fmt::format(", {:.2f} million {}/s", static_cast<double>(done) / elapsed * 1e-6, unit_);
  if (done < total) text += fmt::format(", about {:.0f} s left", elapsed * (1 - fraction) / fraction);
  return text;
}

void Progress::Update(uint64_t done, uint64_t total) {
  if (quiet_ || total == 0) return;
  const double fraction = static_cast<double>(done) / static_cast<double>(total);
  if (terminal_) {
    const auto now = Clock::now();
    if (done < total && now - shown_ < std::chrono::milliseconds(200)) return;
    shown_ = now;
    fmt::print(stderr, "\r{}: {:3.0f} %{} \033[K", phase_, fraction * 100, Details(done, total));
    open_ = true;
  } else if (const int tenth = static_cast<int>(fraction * 10); tenth > tenth_) {
    tenth_ = tenth;
    fmt::print(stderr, "{}: {} %{}\n", phase_, tenth * 10, Details(done, total));
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
