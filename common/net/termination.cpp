#include "common/net/termination.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <utility>

#include "common/base/cleanup.h"

namespace quarry {
namespace {

class SignalledTermination final : public Termination {
 public:
  SignalledTermination(boost::asio::io_context& io, std::function<void()> on_request)
      : on_request_(std::move(on_request)), descriptor_(io) {
    const int descriptor = AwaitTermination();
    if (descriptor < 0) return;
    descriptor_.assign(descriptor);
    descriptor_.async_wait(boost::asio::posix::stream_descriptor::wait_read,
                           [this, alive = alive_](const boost::system::error_code& e) {
                             if (!e && *alive) on_request_();
                           });
  }
  ~SignalledTermination() override {
    *alive_ = false;
    AwaitTerminationNoMore();
  }

 private:
  std::function<void()> on_request_;
  boost::asio::posix::stream_descriptor descriptor_;
  const std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< false once this is destroyed
};

}  // namespace

std::unique_ptr<Termination> Termination::Take(boost::asio::io_context& io,
                                               std::function<void()> on_request) {
  return std::make_unique<SignalledTermination>(io, std::move(on_request));
}

}  // namespace quarry
