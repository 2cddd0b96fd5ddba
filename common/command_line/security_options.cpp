#include "common/command_line/security_options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

namespace quarry {

void AddSecurityOptions(CLI::App& command, SecurityOptions& options) {
  for (const SecurityOptionName& name : SecurityOptionNames())
    command.add_option(name.flag, options.*name.field, fmt::format("{} (Env:{})", name.help, name.variable));
}

}  // namespace quarry
