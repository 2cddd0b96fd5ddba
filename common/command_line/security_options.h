#pragma once

#include "common/net/security.h"

namespace CLI {
class App;
}

namespace quarry {

/// --secret-file, --tls-cert, --tls-key and --tls-ca of a program, into `options`. WithEnvironment() adds the
/// environment's values after parsing.
void AddSecurityOptions(CLI::App& command, SecurityOptions& options);

}  // namespace quarry
