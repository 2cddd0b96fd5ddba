#pragma once

#include <string>
#include <string_view>

#include "common/base/status.h"

namespace quarry {

/// Text of a stranger (a file, a name in a model, a server's answer) for a terminal or a log: control codes,
/// bytes that are no UTF-8, and letters that turn the direction of writing become \xNN and \u{NNNN}. A tab
/// and the end of a line stay. Thread-safe.
std::string Printable(std::string_view text);
/// The same on one line: the ends of lines are escaped too.
std::string PrintableName(std::string_view text);

/// Writes `text`, made printable, and the end of the line to standard error, by one write(2): lines of
/// several threads and processes do not mix. Text that cannot be written is lost (a full disk, a closed
/// descriptor, a reader that is gone): the program continues. Never throws; blocks as write(2) does.
/// Thread-safe.
void Log(std::string_view text) noexcept;
/// Writes `text` as it is, without an end of line: for a line of progress that is rewritten in place.
void LogRaw(std::string_view text) noexcept;

/// Writes `text`, made printable, to standard output, buffered: results for a person. Names of strangers in
/// it, which may hold ends of lines, go through PrintableName() before.
/// Returns: false once something could not be written; later text is then lost, and callers may leave it out.
/// Never throws. Thread-safe.
bool Print(std::string_view text) noexcept;
/// The same for programs: JSON, scripts. The text is written as it is.
bool PrintRaw(std::string_view text) noexcept;
/// Writes the text that Print() has buffered. Returns: false as Print().
bool FlushOutput() noexcept;
/// Whether all output was written, at the end of a program. A reader that has seen enough (`| head`) is no
/// error. Errors: standard output cannot be written, and why.
Status FinishOutput();

}  // namespace quarry
