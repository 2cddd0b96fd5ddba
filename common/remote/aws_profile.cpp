#include "common/remote/aws_profile.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "common/remote/environment.h"
#include "common/remote/secret_file.h"

namespace quarry {
namespace {

using Values = std::map<std::string, std::string, std::less<>>;

/// The section "[name]" of a file of AWS tools; nothing if it lacks the section.
std::optional<Values> SectionOf(std::string_view text, std::string_view name) {
  std::optional<Values> values;
  bool inside = false;
  while (!text.empty()) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    if (line.ends_with('\r')) line.remove_suffix(1);
    // An indented line belongs to a nested value ("s3 =" and below), which is not used here.
    const bool nested = line.starts_with(' ') || line.starts_with('\t');
    line = Trimmed(line);
    if (line.empty() || line.starts_with('#') || line.starts_with(';')) continue;
    if (line.starts_with('[')) {
      const std::string_view section = Trimmed(line.substr(1, line.find(']') - 1));
      inside = section == name;
      if (inside && !values) values.emplace();
      continue;
    }
    const size_t equals = line.find('=');
    if (!inside || nested || equals == std::string_view::npos) continue;
    const std::string_view value = line.substr(equals + 1);
    values->insert_or_assign(Lower(Trimmed(line.substr(0, equals))),
                             std::string(Trimmed(value.substr(0, value.find(" #")))));
  }
  return values;
}

/// The text of a file of AWS tools: the variable's, or the one in ~/.aws; empty when the latter is not there.
Result<std::string> TextOf(const char* variable, const char* name) {
  std::string path = Environment({variable});
  if (path.empty()) {
    const std::string home = Environment({"HOME"});
    path = home + "/.aws/" + name;
    struct stat info {};
    if (home.empty() || ::stat(path.c_str(), &info) != 0) return std::string();
  }
  return ReadPlainFile(path);
}

}  // namespace

Result<AwsProfile> ReadAwsProfile() {
  const std::string chosen = Environment({"AWS_PROFILE", "AWS_DEFAULT_PROFILE"});
  AwsProfile profile;
  profile.name = chosen.empty() ? "default" : chosen;
  QUARRY_ASSIGN(const std::string secrets, TextOf("AWS_SHARED_CREDENTIALS_FILE", "credentials"));
  QUARRY_ASSIGN(const std::string config, TextOf("AWS_CONFIG_FILE", "config"));
  const auto first = SectionOf(secrets, profile.name);
  auto second = SectionOf(config, "profile " + profile.name);
  if (!second && profile.name == "default") second = SectionOf(config, "default");
  if (!first && !second && !chosen.empty())
    return BadUsage(
        fmt::format("AWS_PROFILE: there is no profile {} in the files of AWS tools "
                    "(~/.aws/credentials, ~/.aws/config)",
                    chosen));
  const auto value = [&](std::string_view key) -> std::string {
    for (const auto& values : {first, second})
      if (values)
        if (const auto found = values->find(key); found != values->end()) return found->second;
    return {};
  };
  profile.region = value("region");
  profile.access_key = value("aws_access_key_id");
  profile.secret_key = value("aws_secret_access_key");
  profile.session_token = value("aws_session_token");
  profile.endpoint = value("endpoint_url");
  for (const char* means : {"sso_session", "sso_start_url", "credential_process", "role_arn",
                            "web_identity_token_file", "login_session"})
    if (profile.other_means.empty() && !value(means).empty()) profile.other_means = means;
  return profile;
}

Result<std::string> AwsRegion() {
  std::string region = Environment({"AWS_REGION", "AWS_DEFAULT_REGION"});
  if (region.empty()) {
    QUARRY_ASSIGN(const AwsProfile profile, ReadAwsProfile());
    region = profile.region;
  }
  return region.empty() ? "us-east-1" : region;
}

}  // namespace quarry
