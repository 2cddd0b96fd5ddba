#pragma once

#include <string>

#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {

/// A place that blocks come from, as given on command lines: "master", "HOST:PORT" (a Quarry server),
/// "file:PATH", "http://...", "https://..." or "s3://BUCKET/KEY".
struct SourceSpec {
  SourceKind kind = SourceKind::kTcp;
  bool master = false;  ///< the server inside the master
  Endpoint server;      ///< for kTcp
  std::string place;    ///< the path for kFile, the URL for kHttp
};
/// Errors (usage): none of these forms.
Result<SourceSpec> ParseSource(const std::string& text);

}  // namespace quarry
