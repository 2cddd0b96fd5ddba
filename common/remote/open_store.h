#pragma once

#include <string>

#include "common/base/status.h"
#include "common/remote/http_options.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// Whether `place` names a store on a server: http://, https:// or s3://.
bool IsRemote(const std::string& place);

/// The address of a store on a server. "s3://BUCKET/KEY" is a file of Amazon's S3 in AwsRegion(), or of the
/// server that AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL or the profile's endpoint_url names.
/// Errors (usage): not such an address; as ParseHttpLocation(), ReadAwsProfile().
Result<HttpLocation> RemoteLocation(const std::string& place, const std::string& what);

/// Requests to s3:// are signed by the AWS_* variables or the profile of ~/.aws, where no other credentials
/// are given and they hold some. Errors: as AwsCredentialsFromEnvironment().
Result<HttpOptions> WithCredentials(const std::string& place, HttpOptions options);

/// Opens a store, a file or one on a server. Errors: as StoreReader::Open(), RemoteLocation(),
/// WithCredentials(), RemoteFile::Open().
Result<StoreReader> OpenStore(const std::string& place, const HttpOptions& options);

}  // namespace quarry
