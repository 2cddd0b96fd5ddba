#pragma once

#include <string>

#include "common/base/status.h"
#include "common/net/connection.h"
#include "common/scene/scene_summary.h"

namespace quarry {

/// Asks a master, and waits for the answer: JSON. `topic`: kSceneTopic or kStatusTopic.
/// Errors: out of reach, mismatched security or version; the master's own message; no answer within 60 s.
Result<std::string> AskMaster(const Endpoint& master, const Security& security, const std::string& topic);

/// The master's scene, as far as a client must know it. Errors: as AskMaster(); an answer that cannot be.
Result<SceneSummary> AskForScene(const Endpoint& master, const Security& security);

/// Prints the state of the master's cluster, as JSON or as text. Errors: as AskMaster().
Status PrintStatus(const Endpoint& master, const Security& security, bool json);

}  // namespace quarry
