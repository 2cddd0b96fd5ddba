#include "master/display/encoding_thread.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <utility>

namespace quarry {

namespace asio = boost::asio;

EncodingThread::EncodingThread(asio::io_context& io)
    : io_(io), thread_(std::make_unique<asio::thread_pool>(1)) {}

EncodingThread::~EncodingThread() { Join(); }

void EncodingThread::Join() { thread_->join(); }

void EncodingThread::Encode(Work work, std::function<void(const Result<EncodedFrame>&)> then) {
  asio::post(*thread_, [this, work = std::move(work), then = std::move(then)]() mutable {
    auto encoded = std::make_shared<const Result<EncodedFrame>>(
        encoder_.Encode(*work.frame, work.scene, work.quality, *work.tone));
    asio::post(io_, [encoded, then = std::move(then)] { then(*encoded); });
  });
}

}  // namespace quarry
