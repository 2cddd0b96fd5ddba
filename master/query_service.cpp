#include "master/query_service.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/resource.h"
#include "common/engine/framing_probe.h"
#include "common/scene/scene_summary.h"
#include "common/voxel/store_description.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

void SendJson(Connection& client, const std::string& json) {
  const auto bytes = AsBytes(json);
  client.Send({MessageType::kAnswer, 0, {}, Bytes(bytes.begin(), bytes.end())});
}

Result<std::string> DescribeScene(const Scene& scene) {
  QUARRY_ASSIGN(const Framing framing, ProbeFraming(scene, 0, true));
  nlohmann::ordered_json j = DescribeFacts(scene.store());
  j["framing"] = FramingToJson(framing, scene.catalog().meta.offset);
  return j.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace

QueryService::QueryService(asio::io_context& io, Scene scene, std::function<std::string()> status)
    : io_(io),
      scene_(std::move(scene)),
      status_(std::move(status)),
      thread_(std::make_unique<asio::thread_pool>(1)) {}

QueryService::~QueryService() = default;

void QueryService::Answer(const std::shared_ptr<Connection>& client, const Query& query) {
  if (query.topic == kStatusTopic) return SendJson(*client, status_());
  Describe([waiting = std::weak_ptr(client)](const Result<std::string>& description) {
    const auto here = waiting.lock();
    if (!here) return;
    if (description)
      SendJson(*here, *description);
    else
      here->Send(MakeMessage(MessageType::kFailure, Failure{description.error().message}));
  });
}

void QueryService::Describe(std::function<void(const Result<std::string>&)> then) {
  if (description_) return then(*description_);
  waiting_.push_back(std::move(then));
  if (waiting_.size() > 1) return;
  asio::post(*thread_, [this] {
    asio::post(io_, [this, description = WithinLimits([&] { return DescribeScene(scene_); })]() mutable {
      description_ = std::move(description);
      for (const auto& waiting : std::exchange(waiting_, {})) waiting(*description_);
    });
  });
}

}  // namespace quarry
