#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/engine/scene.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace boost::asio {
class io_context;
class thread_pool;
}  // namespace boost::asio

namespace quarry {

/// Answers clients' questions about the scene and the cluster. The scene is looked at once, when the first
/// client asks, on a thread of this class. Not thread-safe: used on the io_context's thread.
class QueryService {
 public:
  /// `status`: the cluster's state as JSON. `io` must outlive this.
  QueryService(boost::asio::io_context& io, Scene scene, std::function<std::string()> status);
  ~QueryService();

  /// Sends the answer, at once or when it is known.
  void Answer(const std::shared_ptr<Connection>& client, const Query& query);
  /// Gives the facts about the scene as JSON, at once or when they are known.
  void Describe(std::function<void(const Result<std::string>&)> then);

 private:
  boost::asio::io_context& io_;
  const Scene scene_;
  const std::function<std::string()> status_;
  std::optional<Result<std::string>> description_;                        ///< of the scene, as JSON
  std::vector<std::function<void(const Result<std::string>&)>> waiting_;  ///< for the description
  std::unique_ptr<boost::asio::thread_pool> thread_;  ///< last: its thread uses the members above
};

}  // namespace quarry
