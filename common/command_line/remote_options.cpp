#include "common/command_line/remote_options.h"

#include <CLI/CLI.hpp>

namespace quarry {

void AddRemoteOptions(CLI::App& command, RemoteArguments& arguments) {
  command.add_option(
      "--http-header-file", arguments.header_file,
      "File of lines 'Name: value' to send to a store's HTTP server; only its owner may read it");
  command.add_option("--http-aws", arguments.aws,
                     "Sign requests to a store's server for S3: a JSON file of credentials, or env for AWS_* "
                     "variables or the profile in ~/.aws (default for s3:// where there are any)");
  command.add_option(
      "--http-ca", arguments.ca,
      "Authorities trusted for https stores, PEM (default: AWS_CA_BUNDLE, SSL_CERT_FILE, else the "
      "system's)");
}

Result<HttpOptions> ReadRemoteArguments(const RemoteArguments& arguments) {
  HttpOptions options;
  if (!arguments.header_file.empty()) {
    QUARRY_ASSIGN(options.headers, ReadHttpHeaders(arguments.header_file));
  }
  if (!arguments.aws.empty()) {
    QUARRY_ASSIGN(options.aws, arguments.aws == "env" ? AwsCredentialsFromEnvironment()
                                                      : ReadAwsCredentials(arguments.aws));
  }
  options.tls_ca = arguments.ca;
  options.ca_option = "--http-ca";
  return options;
}

std::vector<std::string> Flags(const RemoteArguments& arguments) {
  std::vector<std::string> flags;
  const auto add = [&](const char* flag, const std::string& value) {
    if (!value.empty()) flags.insert(flags.end(), {flag, value});
  };
  add("--http-header-file", arguments.header_file);
  add("--http-aws", arguments.aws);
  add("--http-ca", arguments.ca);
  return flags;
}

}  // namespace quarry
