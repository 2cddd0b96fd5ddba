#pragma once

#include <string>

#include "common/base/status.h"
#include "common/remote/aws_signature.h"

namespace quarry {

/// A profile as the files of the AWS tools give it. Members that no file has are empty.
struct AwsProfile {
  std::string name;  ///< AWS_PROFILE, else "default"
  std::string region, access_key, secret_key, session_token;
  std::string endpoint;     ///< endpoint_url
  std::string other_means;  ///< the key of means that are not known here: "sso_session", "credential_process"
};

/// Reads the profile that AWS_PROFILE names, or "default", from AWS_SHARED_CREDENTIALS_FILE
/// (~/.aws/credentials) and AWS_CONFIG_FILE (~/.aws/config). The first has precedence.
/// Errors (usage): a file that cannot be read, though it is there or a variable names it; AWS_PROFILE names a
/// profile that neither file has.
Result<AwsProfile> ReadAwsProfile();

/// The region: AWS_REGION, else AWS_DEFAULT_REGION, else the profile's, else us-east-1.
/// Errors: as ReadAwsProfile().
Result<std::string> AwsRegion();

}  // namespace quarry
