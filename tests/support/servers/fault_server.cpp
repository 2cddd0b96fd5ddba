#include "tests/support/servers/fault_server.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <thread>
#include <vector>

namespace quarry::test {

struct FaultServer::Impl {
  explicit Impl(Handler h) : handler(std::move(h)) {
    listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* any = reinterpret_cast<sockaddr*>(&address);
    if (listener < 0 || ::bind(listener, any, size) != 0 || ::listen(listener, 64) != 0 ||
        ::getsockname(listener, any, &size) != 0) {
      std::perror("fault server");
      std::abort();
    }
    port = ntohs(address.sin_port);
    acceptor = std::thread([this] { Accept(); });
  }

  ~Impl() {
    {
      const std::lock_guard lock(mutex);
      ending = true;
      ::shutdown(listener, SHUT_RDWR);
      for (const int fd : open) ::shutdown(fd, SHUT_RDWR);
    }
    acceptor.join();
    for (std::thread& t : threads) t.join();
    for (const int fd : open) ::close(fd);
    ::close(listener);
  }

  void Accept() {
    for (int number = 0;; ++number) {
      const int fd = ::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC);
      if (fd < 0) return;
      const int on = 1;
      ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      const std::lock_guard lock(mutex);
      open.push_back(fd);
      if (ending) return;
      threads.emplace_back([this, fd, number] { Serve(fd, number); });
    }
  }

  void Serve(int fd, int connection) {
    std::string read;
    for (int i = 0;; ++i) {
      size_t end;
      while ((end = read.find("\r\n\r\n")) == std::string::npos) {
        char buffer[4096];
        const ssize_t n = ::recv(fd, buffer, sizeof buffer, 0);
        if (n <= 0) return;
        read.append(buffer, static_cast<size_t>(n));
      }
      Request request;
      request.head = read.substr(0, end + 2);
      request.on_connection = i;
      request.connection = connection;
      read.erase(0, end + 4);
      if (const size_t at = request.head.find("Range: bytes="); at != std::string::npos)
        std::sscanf(request.head.c_str() + at, "Range: bytes=%lu-%lu", &request.first, &request.last);
      Answer answer;
      {
        const std::lock_guard lock(mutex);
        request.number = requests++;
        answer = handler(request);
      }
      for (size_t done = 0; done < answer.bytes.size();) {
        const bool trickle = answer.then == Then::kTrickle;
        const size_t size = std::min<size_t>(answer.bytes.size() - done, trickle ? 8 << 10 : SIZE_MAX);
        const ssize_t n = ::send(fd, answer.bytes.data() + done, size, MSG_NOSIGNAL);
        if (n <= 0) return;
        done += static_cast<size_t>(n);
        if (trickle) std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
      if (answer.then == Then::kClose || answer.then == Then::kTrickle) ::shutdown(fd, SHUT_RDWR);
      if (answer.then != Then::kKeep) return;
    }
  }

  Handler handler;
  int listener = -1;
  uint16_t port = 0;
  std::mutex mutex;
  bool ending = false;
  int requests = 0;
  std::vector<int> open;
  std::vector<std::thread> threads;
  std::thread acceptor;
};

FaultServer::FaultServer(Handler handler) : impl_(std::make_unique<Impl>(std::move(handler))) {}
FaultServer::~FaultServer() = default;

uint16_t FaultServer::port() const { return impl_->port; }

std::string FaultServer::url() const { return fmt::format("http://127.0.0.1:{}/store", impl_->port); }

std::string FaultServer::Part(const Request& request, const std::string& file) {
  const std::string body = file.substr(request.first, request.last - request.first + 1);
  return fmt::format(
      "HTTP/1.1 206 Partial Content\r\nContent-Length: {}\r\nContent-Range: bytes {}-{}/{}\r\n\r\n{}",
      body.size(), request.first, request.last, file.size(), body);
}

}  // namespace quarry::test
