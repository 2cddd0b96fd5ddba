#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <utility>

#include "common/base/cleanup.h"
#include "common/base/resource.h"
#include "worker/session.h"

// How a Session ends by SIGTERM.

namespace quarry {
namespace {

namespace asio = boost::asio;

constexpr double kLeaveS = 0.8;      // after SIGTERM, for tiles that are begun
constexpr double kFarewellS = 0.15;  // then, for the master to close the connection

}  // namespace

void Session::StartLeaving() {
  Log(fmt::format("leaves; {} tiles so far", tiles_));
  if (gives_up_) return End(tl::unexpected<Error>(*gives_up_));
  // A name of the master's that is being resolved would delay the usual end.
  if (!connection_ || !welcomed_ || !scene_) EndAtOnce(0);
  leaves_ = true;
  leaves_since_ = Clock::now();
  scene_->renderer->GiveBackQueued();
  asio::post(*io_, [this] {  // after the tiles that were given back
    SendLeave(false);
    AwaitOpenTiles();
  });
}

void Session::GiveBack(const TileOrder& order) {
  given_back_.frames.push_back(order.frame);
  given_back_.leases.push_back(order.lease);
}

void Session::SendLeave(bool last) {
  given_back_.last = last;
  if (connection_) connection_->Send(MakeMessage(MessageType::kLeave, std::exchange(given_back_, {})));
}

void Session::AwaitOpenTiles() {
  constexpr double kOftenS = 0.005;
  if (scene_->renderer->has_open() && SecondsSince(leaves_since_) < kLeaveS)
    return leaving_.Set(kOftenS, [this] { AwaitOpenTiles(); });
  asio::post(*io_, [this] {  // after the results
    SendLeave(true);
    leaving_.Set(kFarewellS, [this] { End({}); });
  });
}

}  // namespace quarry
