#include "common/base/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/file.h"
#include "common/base/log.h"

namespace quarry {

namespace {

// With less time (s) or less work (fraction) than this, rate and estimate are noise.
constexpr double kLeastSeconds = 0.5, kLeastFraction = 0.005, kLeastOfStages = 0.03;

}  // namespace

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(::isatty(2) != 0) {
  if (const char* file = std::getenv("QUARRY_PROGRESS_FILE")) file_ = file;
}

void Progress::BeginStage(double share) {
  if (!std::exchange(has_stages_, true)) stages_begun_ = Clock::now();
  stage_begin_ += stage_share_;
  stage_share_ = share;
}

void Progress::Begin(std::string phase, std::string unit, uint64_t before) {
  End();
  phase_ = PrintableName(phase);
  unit_ = std::move(unit);
  before_ = before;
  begun_ = Clock::now();
  if (has_stages_) return;
  shown_ = begun_;
  tenth_ = -1;
  written_ = {};
}

/// The part that is done: of the phase, or of all stages.
double Progress::OfWhole(uint64_t done, uint64_t total) {
  const double of_phase = static_cast<double>(done) / static_cast<double>(total);
  if (!has_stages_) return of_phase;
  whole_ = std::max(whole_, std::min(stage_begin_ + stage_share_ * of_phase, 1.0));
  if (first_whole_ < 0) first_whole_ = whole_;
  return whole_;
}

/// Below 0: not known.
double Progress::SecondsLeft(uint64_t done, uint64_t total) const {
  const double elapsed =
      std::chrono::duration<double>(Clock::now() - (has_stages_ ? stages_begun_ : begun_)).count();
  if (has_stages_) {
    const double made = whole_ - first_whole_;
    return elapsed < kLeastSeconds || made < kLeastOfStages ? -1 : elapsed * (1 - whole_) / made;
  }
  if (done <= before_ || total <= before_) return -1;
  const double fraction = static_cast<double>(done - before_) / static_cast<double>(total - before_);
  if (elapsed < kLeastSeconds || fraction < kLeastFraction) return -1;
  return elapsed * (1 - fraction) / fraction;
}

void Progress::Write(uint64_t done, uint64_t total) {
  const auto now = Clock::now();
  if (now - written_ < std::chrono::milliseconds(250)) return;
  written_ = now;
  const double fraction = OfWhole(done, total), left_s = SecondsLeft(done, total);
  nlohmann::ordered_json j{{"step", phase_}, {"done", fraction}};
  j["eta_s"] = left_s < 0 ? nlohmann::ordered_json() : nlohmann::ordered_json(left_s);
  // An error is ignored: readers look at the file again, and it is soon rewritten.
  (void)WriteFileAtomically(
      file_, AsBytes(j.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n"));
}

std::string Progress::Details(uint64_t done, uint64_t total) const {
  const double elapsed = std::chrono::duration<double>(Clock::now() - begun_).count();
  const auto made = static_cast<double>(done - std::min(done, before_));
  const double left_s = SecondsLeft(done, total);
  const bool has_rate = made > 0 && elapsed >= kLeastSeconds && !unit_.empty();
  std::string text;
  if (has_rate && unit_ == "bytes")
    text = fmt::format(", {:.0f} MB/s", made / elapsed * 1e-6);
  else if (has_rate)
    text = fmt::format(", {:.2f} million {}/s", made / elapsed * 1e-6, unit_);
  if (left_s >= 0 && (has_stages_ || done < total)) text += fmt::format(", about {:.0f} s left", left_s);
  return text;
}

void Progress::Update(uint64_t done, uint64_t total) {
  if (total > 0 && !file_.empty()) Write(done, total);
  if (quiet_ || total == 0) return;
  const double fraction = OfWhole(done, total);
  if (terminal_) {
    const auto now = Clock::now();
    // At most five lines per second on a terminal.
    if ((has_stages_ || done < total) && now - shown_ < std::chrono::milliseconds(200)) return;
    shown_ = now;
    Show(fmt::format("{:3.0f} %", fraction * 100), Details(done, total));
    open_ = true;
  } else if (const int tenth = static_cast<int>(fraction * 10); tenth > tenth_) {
    tenth_ = tenth;
    Log(fmt::format("{}: {} %{}", phase_, tenth * 10, Details(done, total)));
  }
}

/// A line wider than the terminal cannot be rewritten in place. First the details are dropped, then the
/// phase's name, which holds a path, is cut.
void Progress::Show(const std::string& state, const std::string& details) {
  winsize size{};
  size_t columns = ::ioctl(2, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
  columns -= std::min<size_t>(columns, 1);  // one column for the cursor
  std::string line = fmt::format("{}: {}{}", phase_, state, details);
  if (line.size() > columns) line = fmt::format("{}: {}", phase_, state);
  if (line.size() > columns) {
    const size_t room = columns - std::min(columns, state.size() + 5);
    std::string phase = phase_.substr(0, room);
    // not in the middle of a UTF-8 letter
    while (!phase.empty() && (phase.back() & 0x80) != 0) phase.pop_back();
    line = fmt::format("{}...: {}", phase, state).substr(0, columns);
  }
  LogRaw(fmt::format("\r{}\033[K", line));
}

void Progress::End() {
  if (!has_stages_) EndLine();
}

void Progress::EndStages() {
  EndLine();
  has_stages_ = false;
}

void Progress::EndLine() {
  if (open_) {
    Show("done");
    Log("");
  }
  open_ = false;
}

void Progress::Say(const std::string& text) {
  if (quiet_) return;
  if (open_) LogRaw("\r\033[K");
  Log(text);
}

}  // namespace quarry
