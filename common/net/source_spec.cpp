#include "common/net/source_spec.h"

#include <fmt/format.h>

#include <utility>

namespace quarry {

Result<SourceSpec> ParseSource(const std::string& text) {
  SourceSpec spec;
  if (text == "master") {
    spec.master = true;
    return spec;
  }
  if (text.starts_with("http://") || text.starts_with("https://") || text.starts_with("s3://")) {
    spec.kind = SourceKind::kHttp;
    spec.place = text;
    return spec;
  }
  if (text.rfind("file:", 0) == 0 && text.size() > 5) {
    spec.kind = SourceKind::kFile;
    spec.place = text.substr(5);
    return spec;
  }
  auto server = ParseEndpoint(text, "--source");
  if (!server)
    return BadUsage(fmt::format(
        "--source is master, HOST:PORT, file:PATH, http://..., https://... or s3://..., not '{}'", text));
  spec.server = std::move(*server);
  return spec;
}

}  // namespace quarry
