#include "common/net/timer.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <utility>

namespace quarry {

struct Timer::Impl {
  boost::asio::steady_timer timer;
  /// Counts calls that are asked for or cancelled. A timer that has expired calls its handler even if it is
  /// cancelled or destroyed before, so that each handler looks here whether its call is still wanted.
  std::shared_ptr<uint64_t> generation = std::make_shared<uint64_t>(0);
};

Timer::Timer(boost::asio::io_context& io) : impl_(new Impl{boost::asio::steady_timer(io)}) {}
Timer::~Timer() { ++*impl_->generation; }

void Timer::Set(double seconds, std::function<void()> then) {
  impl_->timer.expires_after(std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(seconds)));
  impl_->timer.async_wait([then = std::move(then), generation = impl_->generation,
                           mine = ++*impl_->generation](const boost::system::error_code& error) {
    if (!error && mine == *generation) then();
  });
}

void Timer::Stop() {
  ++*impl_->generation;
  impl_->timer.cancel();
}

}  // namespace quarry
