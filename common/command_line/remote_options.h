#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/remote/http_options.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of a command about stores on servers.
struct RemoteArguments {
  std::string header_file, aws, ca;
};

/// Adds --http-header-file, --http-aws and --http-ca to a command that opens stores.
void AddRemoteOptions(CLI::App& command, RemoteArguments& arguments);
/// The requests' settings. Errors: as ReadHttpHeaders(), ReadAwsCredentials(),
/// AwsCredentialsFromEnvironment().
Result<HttpOptions> ReadRemoteArguments(const RemoteArguments& arguments);
/// The same arguments for another program.
std::vector<std::string> Flags(const RemoteArguments& arguments);

}  // namespace quarry
