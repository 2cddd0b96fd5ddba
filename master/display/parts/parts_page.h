#pragma once

#include <glm/vec3.hpp>

#include "common/http/http_server.h"
#include "master/part_selections.h"

namespace quarry {

/// Answers `./parts`: the parts of a scene in pages, by parent, by name or by number, as JSON. See
/// PROTOCOL.md. Not thread-safe.
class PartsPage {
 public:
  /// Most parts in one answer.
  static constexpr uint32_t kMost = 1000;
  /// `selections` has the scene's parts, and must outlive this. `offset`: SceneMeta::offset.
  PartsPage(PartSelections& selections, const glm::dvec3& offset)
      : selections_(selections), offset_(offset) {}

  /// The answer to a request's query. One that is not understood gets 400 with a sentence. Requires: the
  /// request has the session.
  HttpResponse Answer(const HttpRequest& request) const;

 private:
  PartSelections& selections_;
  const glm::dvec3 offset_;
};

}  // namespace quarry
