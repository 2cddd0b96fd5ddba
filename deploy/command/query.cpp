#include "deploy/command/query.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/json_file.h"
#include "common/base/log.h"
#include "common/base/size.h"
#include "common/net/timer.h"
#include "common/protocol/messages.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

/// Seconds until a question is given up: the first about a large scene reads some of its blocks.
constexpr double kAnswerS = 60;
constexpr JsonLimits kAnswerLimits{.bytes = 256u << 20, .depth = 16, .values = 16u << 20, .members = 1000};

/// One question on a connection of its own.
class Question {
 public:
  Question(const Endpoint& master, const Security& security, std::string topic)
      : master_(master), security_(security), topic_(std::move(topic)), limit_(io_), beat_(io_) {}

  Result<std::string> Ask() {
    limit_.Set(kAnswerS,
               [this] { End(Fail(fmt::format("the master has not answered for {:.0f} s", kAnswerS))); });
    Connect(io_, master_, security_, [this](Result<std::shared_ptr<Connection>> result) {
      if (!result) return End(tl::unexpected<Error>(result.error()));
      connection_ = std::move(*result);
      connection_->Expect(Speaker::kMasterOfClients);
      connection_->Start([this](const Message& m) { OnMessage(m); },
                         [this](const Error& e) { End(tl::unexpected<Error>(e)); });
      connection_->Send(MakeMessage(MessageType::kHello, Hello{Role::kClient, "quarry", 0}));
      Beat();
    });
    io_.run();
    return std::move(outcome_);
  }

 private:
  void Beat() {
    connection_->Send({MessageType::kPing, 0, {}, {}});
    beat_.Set(kHeartbeatS, [this] { Beat(); });
  }

  void OnMessage(const Message& m) {
    if (m.type == MessageType::kWelcome)
      return connection_->Send(MakeMessage(MessageType::kQuery, Query{topic_}));
    if (m.type == MessageType::kAnswer) return End(std::string(AsText(m.raw)));
    if (m.type != MessageType::kFailure) return;
    const auto failure = DecodeFailure(m.table);
    End(Fail(failure ? failure->message : failure.error().message));
  }

  void End(Result<std::string> outcome) {
    outcome_ = std::move(outcome);
    io_.stop();
  }

  asio::io_context io_;
  const Endpoint& master_;
  const Security& security_;
  const std::string topic_;
  Timer limit_, beat_;
  std::shared_ptr<Connection> connection_;
  Result<std::string> outcome_;
};

}  // namespace

Result<std::string> AskMaster(const Endpoint& master, const Security& security, const std::string& topic) {
  return Question(master, security, topic).Ask();
}

Result<SceneSummary> AskForScene(const Endpoint& master, const Security& security) {
  static const std::string kName = "the master's scene";
  QUARRY_ASSIGN(const std::string text, AskMaster(master, security, kSceneTopic));
  QUARRY_ASSIGN(const auto json, ParseJson<nlohmann::json>(text, kName, kAnswerLimits));
  return ReadSceneSummary(JsonValue(json, kName));
}

namespace {

/// ", about 12 s left"; empty where the master cannot tell.
std::string TimeLeft(const nlohmann::ordered_json& job) {
  const auto left = job.find("left_s");
  return left == job.end() || !left->is_number() ? ""
                                                 : fmt::format(", about {:.0f} s left", left->get<double>());
}

}  // namespace

Status PrintStatus(const Endpoint& master, const Security& security, bool as_json) {
  QUARRY_ASSIGN(const std::string text, AskMaster(master, security, kStatusTopic));
  QUARRY_ASSIGN(const auto json,
                ParseJson<nlohmann::ordered_json>(text, "the master's status", kAnswerLimits));
  if (as_json) {
    PrintRaw(json.dump(2) + "\n");
    return {};
  }
  try {
    Print(fmt::format("scene {}, up {:.0f} s, {:.2f} million rays/s, {}/s of voxels served\n",
                      json.at("scene_id").get<std::string>(), json.at("up_s").get<double>(),
                      json.at("rays_per_s").get<double>() * 1e-6,
                      FormatSize(static_cast<uint64_t>(json.at("voxel_bytes_served_per_s").get<double>()))));
    Print(fmt::format("workers: {}\n", json.at("workers").size()));
    for (const auto& w : json.at("workers"))
      Print(fmt::format(
          "  {}: {} threads, load {:.0f} %, {} tiles, cache {}, {} received, {:.1f} million rays\n",
          PrintableName(w.at("name").get<std::string>()), w.at("threads").get<uint64_t>(),
          100 * w.value("load", 0.0), w.at("tiles").get<uint64_t>(),
          FormatSize(w.at("cache_bytes").get<uint64_t>()),
          FormatSize(w.at("voxel_bytes_received").get<uint64_t>()), w.at("rays").get<double>() * 1e-6));
    Print(fmt::format("jobs: {}\n", json.at("jobs").size()));
    for (const auto& job : json.at("jobs"))
      Print(fmt::format("  {}: {}; {} of {} frames finished, {} clients, {:.0f} s{}\n",
                        job.at("id").get<std::string>(), PrintableName(job.at("what").get<std::string>()),
                        job.at("frames_finished").get<uint64_t>(), job.at("frames").get<uint64_t>(),
                        job.at("clients").get<uint64_t>(), job.at("age_s").get<double>(), TimeLeft(job)));
  } catch (const nlohmann::json::exception&) {
    return Fail("the master's status is not well formed");
  }
  return {};
}

}  // namespace quarry
