// Many connections to a program that listens, each the worst that a stranger can do, again and again until
// standard input ends. Usage: quarry-test-strangers HOST:PORT COUNT KIND,... (see kKinds). Prints "ready"
// when all have connected once.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <functional>
#include <map>
#include <sstream>
#include <thread>

#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {
namespace {

std::atomic<bool> over{false};
std::atomic<int> connected{0};

/// A socket whose every call gives up after a while, without an error.
class Peer {
 public:
  explicit Peer(uint16_t port) : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const timeval patience{0, 300'000};
    ::setsockopt(fd_, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    open_ = ::connect(fd_, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
    ++connected;
  }
  ~Peer() { ::close(fd_); }

  void Send(std::span<const std::byte> bytes) {
    while (open_ && !bytes.empty()) {
      const auto n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n <= 0 && errno != EAGAIN && errno != EWOULDBLOCK) open_ = false;
      if (n <= 0 && over) return;
      if (n <= 0 && ++stuck_ > 3) return;
      if (n > 0) bytes = bytes.subspan(static_cast<size_t>(n));
    }
  }
  void Say(const Message& m) {
    Send(EncodeFrameHeader(m));
    Send(m.table);
    Send(m.raw);
  }
  void Greet(Role role) {
    Send(EncodePreamble());
    Say(MakeMessage(MessageType::kHello, Hello{role, "stranger", 1000, uint64_t(::random()) << 20 | 1, 0}));
  }
  /// Only the header of a message with so many bytes.
  void Claim(MessageType type, uint32_t table, uint32_t raw) {
    Bytes header = EncodeFrameHeader({type, 1, {}, {}});
    std::memcpy(header.data() + 16, &table, 4);
    std::memcpy(header.data() + 20, &raw, 4);
    const uint64_t checksum = Checksum(std::span(header).first(kFrameHeaderBytes - 8));
    std::memcpy(header.data() + kFrameHeaderBytes - 8, &checksum, 8);
    Send(header);
  }
  /// Keeps the connection, reading nothing, until the other side closes it.
  void Stay(const std::function<void()>& each_second = [] {}) {
    for (int i = 0; open_ && !over; ++i) {
      pollfd watched{fd_, POLLRDHUP, 0};
      if (::poll(&watched, 1, 100) > 0) return;
      if (i % 10 == 9) each_second();
    }
  }

 private:
  int fd_;
  bool open_ = false;
  int stuck_ = 0;
};

const std::map<std::string, std::function<void(Peer&)>> kKinds = {
    {"silent", [](Peer& p) { p.Stay(); }},
    {"preamble",
     [](Peer& p) {
       p.Send(EncodePreamble());
       p.Stay();
     }},
    {"claim-first",
     [](Peer& p) {
       p.Send(EncodePreamble());
       p.Claim(MessageType::kRenderJob, 256u << 20, 0);
       p.Stay();
     }},
    {"claim",
     [](Peer& p) {
       p.Greet(Role::kVoxels);
       p.Claim(MessageType::kCatalog, 0, 0xF0000000u);
       p.Stay();
     }},
    {"claim-alive",
     [](Peer& p) {
       p.Greet(Role::kWorker);
       p.Claim(MessageType::kWorkerStatus, 16u << 20, 0);
       p.Send(Bytes(15u << 20));
       p.Stay();
     }},
    {"half-job",
     [](Peer& p) {
       p.Greet(Role::kClient);
       p.Claim(MessageType::kRenderJob, 10u << 20, 0);
       p.Send(Bytes(9u << 20));
       p.Stay();
     }},
    {"idle",
     [](Peer& p) {
       p.Greet(Role::kVoxels);
       p.Stay();
     }},
    {"reads-nothing",
     [](Peer& p) {
       p.Greet(Role::kVoxels);
       for (uint32_t i = 0; i < 1000; ++i)
         p.Say(MakeMessage(MessageType::kBlockRequest, BlockRequest{i % 64}, i + 1));
       p.Stay();
     }},
    {"mute",
     [](Peer& p) {
       p.Greet(Role::kWorker);
       p.Stay([&] { p.Say({MessageType::kPing, 0, {}, {}}); });
     }},
};

int Attack(const Endpoint& to, int count, const std::string& kinds) {
  std::vector<std::string> names;
  std::istringstream list(kinds);
  for (std::string name; std::getline(list, name, ',');) names.push_back(name);
  std::vector<std::thread> threads;
  for (int i = 0; i < count; ++i)
    threads.emplace_back([&, act = kKinds.at(names[static_cast<size_t>(i) % names.size()])] {
      while (!over) {
        Peer peer(to.port);
        act(peer);
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
    });
  while (connected < count) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  fmt::print("ready\n");
  std::fflush(stdout);
  while (std::getchar() != EOF) {
  }
  over = true;
  for (std::thread& thread : threads) thread.join();
  return 0;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  const auto to = quarry::ParseEndpoint(argc > 3 ? argv[1] : "", "the address");
  if (!to) return 2;
  return quarry::Attack(*to, std::atoi(argv[2]), argv[3]);
}
