#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace CLI {
class App;
}

namespace quarry {

/// Parses the arguments of a program whose app bears its name. --help and --version are answered on standard
/// output. An error is one sentence on standard error: it begins with the program's name, and for a mistyped
/// option or command it names the nearest known one.
/// Returns: the exit status to end with (0 or 2), or nothing where the program continues.
std::optional<int> ParseCommandLine(CLI::App& app, int argc, char** argv);

/// Two options of which the first has no effect where the second is given, and why.
struct NoEffect {
  const char* option;
  const char* beside;
};

/// Refuses (in ParseCommandLine) an option that has no effect beside another. Values from the environment are
/// never refused: they are meant for many commands.
void RefuseWithoutEffect(CLI::App& command, std::span<const NoEffect> rules);

/// Whether `option` of `command`, a long name ("--eye"), was typed. A value from the environment was not
/// typed.
bool WasTyped(const CLI::App& command, const char* option);

/// The candidate that `text` was probably meant to be; empty when none comes near.
std::string Nearest(const std::string& text, std::span<const std::string> candidates);

/// "a, b or c", with `last_word` before the last. Requires: there are names.
std::string Listed(std::span<const std::string> names, std::string_view last_word);

}  // namespace quarry
