#include "common/base/log.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdio>

#include "common/base/bytes.h"
#include "common/base/descriptor.h"

namespace quarry {
namespace {

/// errno of the first output that was lost; 0: none.
std::atomic<int> output_error{0};

/// A letter and the bytes that it takes; no letter: the first byte is no UTF-8.
struct Letter {
  size_t bytes;
  uint32_t code;
  bool valid;
};

Letter FirstLetter(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<uint8_t>(text[i]); };
  const uint8_t first = byte(0);
  if (first < 0x80) return {1, first, true};
  const size_t bytes = first >= 0xF0 && first < 0xF5 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first >= 0xF5 || text.size() < bytes) return {1, first, false};
  uint32_t code = first & (0xFFu >> (bytes + 1));
  for (size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {1, first, false};
    code = code << 6 | (byte(i) & 0x3Fu);
  }
  constexpr uint32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};  // of letters that need so many bytes
  const bool surrogate = code >= 0xD800 && code < 0xE000;
  const bool valid = code >= kLeast[bytes] && !surrogate && code <= 0x10FFFF;
  return valid ? Letter{bytes, code, true} : Letter{1, first, false};
}

/// Letters that turn the direction of writing (Unicode's Bidi_Control), or separate lines.
bool TurnsLines(uint32_t code) {
  return code == 0x061C || code == 0x200E || code == 0x200F || (code >= 0x2028 && code <= 0x202E) ||
         (code >= 0x2066 && code <= 0x2069);
}

std::string Escaped(std::string_view text, std::string_view kept) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const Letter letter = FirstLetter(text);
    const bool control = letter.code < 0x20 || (letter.code >= 0x7F && letter.code < 0xA0);
    if (!letter.valid || (control && kept.find(text[0]) == kept.npos))
      out += fmt::format("\\x{:02x}", letter.code);
    else if (TurnsLines(letter.code))
      out += fmt::format("\\u{{{:04x}}}", letter.code);
    else
      out += text.substr(0, letter.bytes);
    text.remove_prefix(letter.bytes);
  }
  return out;
}

}  // namespace

std::string Printable(std::string_view text) { return Escaped(text, "\t\n"); }
std::string PrintableName(std::string_view text) { return Escaped(text, "\t"); }

void Log(std::string_view text) noexcept {
  try {
    const std::string line = Printable(text) + '\n';
    (void)WriteAll(2, AsBytes(line));
  } catch (...) {  // no memory for the copy: the text as it is
    (void)WriteAll(2, AsBytes(text));
    (void)WriteAll(2, AsBytes("\n"));
  }
}

void LogRaw(std::string_view text) noexcept { (void)WriteAll(2, AsBytes(text)); }

bool Print(std::string_view text) noexcept {
  try {
    return PrintRaw(Printable(text));
  } catch (...) {  // no memory for the copy
    int none = 0;
    output_error.compare_exchange_strong(none, ENOMEM);
    return false;
  }
}

bool PrintRaw(std::string_view text) noexcept {
  if (output_error.load() != 0) return false;
  errno = 0;
  if (text.empty() || std::fwrite(text.data(), 1, text.size(), stdout) == text.size()) return true;
  output_error.store(errno != 0 ? errno : EIO);
  return false;
}

bool FlushOutput() noexcept {
  if (output_error.load() != 0) return false;
  errno = 0;
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return true;
  output_error.store(errno != 0 ? errno : EIO);
  return false;
}

Status FinishOutput() {
  if (FlushOutput() || output_error.load() == EPIPE) return {};
  return Fail(fmt::format("standard output cannot be written: {}", ErrnoText(output_error.load())));
}

}  // namespace quarry
