#include "common/remote/remote_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <csignal>
#include <future>
#include <memory>
#include <new>
#include <optional>
#include <thread>
#include <utility>

#include "common/base/resource.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

constexpr uint64_t kHeadBytes = 64u << 10;   // kept
constexpr uint64_t kPieceBytes = 16u << 20;  // of one request
constexpr double kRetryS = 10;
constexpr auto kPause = std::chrono::milliseconds(200);  // between attempts

}  // namespace

struct RemoteFile::Impl {
  Impl(const HttpLocation& at, const HttpOptions& settings)
      : name(at.text()),
        location(at),
        options(settings),
        work(io.get_executor()),
        client(std::in_place, io, location, options) {
    thread = std::thread([this] { Serve(); });
  }
  ~Impl() {
    io.stop();
    thread.join();
  }

  /// The thread, which leaves signals to the program's own. A client that has met a failed allocation is
  /// replaced: its requests end unanswered.
  void Serve() {
    ::sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_BLOCK, &all, nullptr);
    while (!io.stopped()) {
      try {
        if (!client) client.emplace(io, location, options);
        io.run();
      } catch (const std::exception&) {  // no memory, or no thread to look a name up
        client.reset();
        std::this_thread::sleep_for(kPause);
      }
    }
  }

  /// One request, from any thread.
  Result<HttpRangeClient::Reply> Ask(uint64_t offset, uint32_t bytes) {
    auto promise = std::make_shared<std::promise<Result<HttpRangeClient::Reply>>>();
    auto reply = promise->get_future();
    asio::post(io, [this, offset, bytes, promise] {
      client->Get(offset, bytes,
                  [promise](Result<HttpRangeClient::Reply> r) { promise->set_value(std::move(r)); });
    });
    promise.reset();
    try {
      return reply.get();
    } catch (const std::future_error&) {  // the request is gone, for want of memory
      throw std::bad_alloc();
    }
  }

  Result<HttpRangeClient::Reply> AskAgain(uint64_t offset, uint32_t bytes) {
    const auto start = std::chrono::steady_clock::now();
    for (;; std::this_thread::sleep_for(kPause)) {
      auto reply = Ask(offset, bytes);
      if (reply || reply.error().permanent() || SecondsSince(start) > kRetryS) return reply;
    }
  }

  Status Read(uint64_t offset, std::span<std::byte> out) {
    while (!out.empty()) {
      const auto piece = static_cast<uint32_t>(std::min<uint64_t>(out.size(), kPieceBytes));
      QUARRY_ASSIGN(const HttpRangeClient::Reply reply, AskAgain(offset, piece));
      if (reply.file_size != 0 && reply.file_size != size)
        return tl::unexpected<Error>(
            Error{fmt::format("{}: the file has {} bytes now, and had {} when it was opened", name,
                              reply.file_size, size),
                  ErrorKind::kPermanent});
      std::ranges::copy(reply.bytes, out.begin());
      offset += piece;
      out = out.subspan(piece);
    }
    return {};
  }

  const std::string name;
  const HttpLocation location;
  const HttpOptions options;
  uint64_t size = 0;
  Bytes head;
  asio::io_context io;
  asio::executor_work_guard<asio::io_context::executor_type> work;
  std::optional<HttpRangeClient> client;  ///< used on the thread
  std::thread thread;
};

RemoteFile::RemoteFile(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RemoteFile::~RemoteFile() = default;

Result<std::unique_ptr<RandomAccessFile>> RemoteFile::Open(const HttpLocation& location,
                                                           const HttpOptions& options) {
  auto impl = std::make_unique<Impl>(location, options);
  QUARRY_ASSIGN(const HttpRangeClient::Reply first, impl->AskAgain(0, 1));
  if (first.file_size == 0)
    return Fail(fmt::format("{}: the server does not state the file's size", impl->name));
  impl->size = first.file_size;
  Bytes head(std::min(kHeadBytes, impl->size));
  QUARRY_TRY(impl->Read(0, head));
  impl->head = std::move(head);
  return std::unique_ptr<RandomAccessFile>(new RemoteFile(std::move(impl)));
}

const std::string& RemoteFile::path() const { return impl_->name; }
uint64_t RemoteFile::size() const { return impl_->size; }

Status RemoteFile::ReadAt(uint64_t offset, std::span<std::byte> out) const {
  if (offset > impl_->size || out.size() > impl_->size - offset)
    return Fail(fmt::format("{}: ends before byte {}", impl_->name, offset + out.size()));
  if (const Bytes& head = impl_->head; offset + out.size() <= head.size()) {
    std::copy_n(head.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }
  return impl_->Read(offset, out);
}

}  // namespace quarry
