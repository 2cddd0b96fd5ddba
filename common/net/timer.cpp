#include "common/net/timer.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <utility>

namespace quarry {

struct Timer::Impl {
  boost::asio::steady_timer timer;
};

Timer::Timer(boost::asio::io_context& io) : impl_(new Impl{boost::asio::steady_timer(io)}) {}
Timer::~Timer() = default;

void Timer::Set(double seconds, std::function<void()> then) {
  impl_->timer.expires_after(std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(seconds)));
  impl_->timer.async_wait([then = std::move(then)](const boost::system::error_code& error) {
    if (!error) then();
  });
}

void Timer::Stop() { impl_->timer.cancel(); }

}  // namespace quarry
