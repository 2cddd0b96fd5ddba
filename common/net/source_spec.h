#pragma once

#include <string>

#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {

/// One place that blocks come from, as it is given on command lines: "master", "HOST:PORT" (Quarry's own
/// servers), "file:PATH", "http://..." or "https://...".
struct SourceSpec {
  SourceKind kind = SourceKind::kTcp;
  bool master = false;  ///< the server of the master itself
  Endpoint server;      ///< kTcp
  std::string place;    ///< kFile: the path; kHttp: the address
};
/// Errors (usage): none of these.
Result<SourceSpec> ParseSource(const std::string& text);

}  // namespace quarry
