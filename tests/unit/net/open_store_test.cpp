#include "common/remote/open_store.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <initializer_list>
#include <string>
#include <vector>

namespace quarry {
namespace {

/// The environment's AWS_* variables that say where S3 is, cleared while this lives.
class NoEndpoint {
 public:
  NoEndpoint() {
    for (const char* name : kNames) {
      const char* value = std::getenv(name);
      values_.emplace_back(value ? value : "");
      ::unsetenv(name);
    }
  }
  ~NoEndpoint() {
    for (size_t i = 0; i < values_.size(); ++i) {
      ::unsetenv(kNames[i]);
      if (!values_[i].empty()) ::setenv(kNames[i], values_[i].c_str(), 1);
    }
  }

 private:
  static constexpr const char* kNames[] = {"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_REGION",
                                           "AWS_DEFAULT_REGION"};
  std::vector<std::string> values_;
};

std::string TextOf(const std::string& place) {
  const auto location = RemoteLocation(place, "the scene");
  return location ? location->text() : location.error().message;
}

}  // namespace

TEST_CASE("An s3:// address is Amazon's, in the environment's region, or the endpoint's") {
  const NoEndpoint none;
  CHECK(TextOf("s3://models/a/plant.quarry") == "https://models.s3.us-east-1.amazonaws.com/a/plant.quarry");
  ::setenv("AWS_DEFAULT_REGION", "eu-west-3", 1);
  CHECK(TextOf("s3://models/a b+c.quarry") == "https://models.s3.eu-west-3.amazonaws.com/a%20b%2Bc.quarry");
  ::setenv("AWS_REGION", "eu-central-1", 1);
  CHECK(TextOf("s3://my.models/plant.quarry") ==
        "https://s3.eu-central-1.amazonaws.com/my.models/plant.quarry");
  ::setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9000/", 1);
  CHECK(TextOf("s3://models/plant.quarry") == "http://127.0.0.1:9000/models/plant.quarry");
  ::setenv("AWS_ENDPOINT_URL_S3", "https://minio.example:9443", 1);
  CHECK(TextOf("s3://models/plant.quarry") == "https://minio.example:9443/models/plant.quarry");
  ::setenv("AWS_ENDPOINT_URL_S3", "minio.example", 1);
  CHECK(RemoteLocation("s3://models/x", "it").error().exit_status() == 2);
}

TEST_CASE("An S3 address without bucket or key is refused, and other names are not addresses of servers") {
  for (const std::string place : {"s3://", "s3://models", "s3:///x", "s3://models/"}) {
    INFO(place);
    CHECK(IsRemote(place));
    const auto location = RemoteLocation(place, "the scene");
    REQUIRE_FALSE(location.has_value());
    CHECK(location.error().message.find("s3://BUCKET/KEY") != std::string::npos);
    CHECK(location.error().exit_status() == 2);
  }
  for (const std::string place : {"plant.quarry", "/s3://x", "file:plant.quarry", "ftp://x/y"})
    CHECK_FALSE(IsRemote(place));
}

}  // namespace quarry
