// Long: reading, writing, opening and closing share all the state of the class.
#include "common/net/stream_connection.h"

#include <fmt/format.h>
#include <linux/sockios.h>
#include <netinet/tcp.h>
#include <openssl/ssl.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <deque>
#include <type_traits>
#include <utility>

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;

// limit for handshake, preamble and greeting together
constexpr auto kOpeningTime = std::chrono::seconds(10);
constexpr auto kClosingTime = std::chrono::seconds(10);  // limit for sending queued messages
constexpr auto kNotifyTime = std::chrono::seconds(1);    // limit for the peer's own close
/// Limits for a half-read message on the accepting side: 30 s, plus its size over the rate of the slowest
/// useful link. Chaos tests send slower than that rate for at most 11 s.
constexpr auto kMessageTime = std::chrono::seconds(30);
// Bytes per second.
constexpr uint64_t kLeastBytesPerS = 16 << 10;
/// Limit for silence. All of Quarry's programs ping more often.
constexpr auto kIdleTime = std::chrono::seconds(60);
/// Limit for a peer that takes no queued bytes. A stopped process is declared dead earlier, by
/// LivenessMonitor.
constexpr auto kUnreadTime = std::chrono::seconds(10);
/// Steps in bytes by which the buffer of a message grows as bytes arrive, so that a claimed size costs no
/// memory: first 16 KiB, then fourfold, then by 64 KiB. Small steps keep connections with large messages from
/// delaying the others. A connecting side chose its peer and takes steps of 1 MiB.
constexpr size_t kFirstStep = 16 << 10, kLargestStep = 64 << 10, kTrustedStep = 1 << 20;

using TlsStream = asio::ssl::stream<tcp::socket>;

std::string EndpointText(const tcp::endpoint& e) {
  const std::string host = e.address().to_string();
  return e.address().is_v6() ? fmt::format("[{}]:{}", host, e.port()) : fmt::format("{}:{}", host, e.port());
}

/// Detects within 30 s that a peer vanished without closing (machine or network failure), also when this side
/// never sends anything.
void KeepAlive(int socket) {
  const int on = 1, idle_s = 15, interval_s = 5, count = 3;
  ::setsockopt(socket, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
  ::setsockopt(socket, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
  ::setsockopt(socket, IPPROTO_TCP, TCP_KEEPINTVL, &interval_s, sizeof interval_s);
  ::setsockopt(socket, IPPROTO_TCP, TCP_KEEPCNT, &count, sizeof count);
}

template <class Stream>
Stream MakeStream(tcp::socket socket, const Security& security) {
  if constexpr (std::is_same_v<Stream, TlsStream>) {
    SSL_CTX_up_ref(security.context());
    asio::ssl::context context(security.context());
    return TlsStream(std::move(socket), context);
  } else {
    return socket;
  }
}

/// Whether the bytes begin a TLS record, an alert or a handshake, where a preamble should be.
bool IsTlsRecord(std::span<const std::byte> bytes) {
  return bytes.size() >= 2 && (bytes[0] == std::byte{0x15} || bytes[0] == std::byte{0x16}) &&
         bytes[1] == std::byte{3};
}

/// The part of a connection that does not depend on its stream: the peer, its limits, and the traffic with
/// it. `host` is the name that a client connects to; empty on the accepting side.
class PeerRecord : public AcceptedConnection {
 public:
  explicit PeerRecord(std::string host)
      : host_(std::move(host)), speaker_(accepted() ? Speaker::kStranger : Speaker::kAnyone) {}

  void Expect(Speaker speaker, uint32_t most_raw_bytes) override {
    speaker_ = speaker;
    most_raw_bytes_ = most_raw_bytes;
  }
  bool newcomer() const override { return !closed_ && !greeted_; }
  bool closed() const override { return closed_; }
  bool fetches() const override { return speaker_ == Speaker::kVoxels; }
  Clock::time_point heard() const override { return heard_; }
  uint64_t queued_bytes() const override { return queued_; }
  double unread_s() const override {
    return queued_ == 0 ? 0 : std::chrono::duration<double>(Clock::now() - taken_since_).count();
  }
  void SetOnSent(std::function<void()> on_sent) override { on_sent_ = std::move(on_sent); }
  uint64_t received_bytes() const override { return received_; }
  const std::string& peer() const override { return peer_; }

 protected:
  bool accepted() const { return host_.empty(); }
  void Heard(size_t bytes) {
    received_ += bytes;
    heard_ = Clock::now();
  }

  const std::string host_;
  Speaker speaker_;
  uint32_t most_raw_bytes_ = ~uint32_t{0};
  std::string peer_;
  bool greeted_ = false;  ///< preamble received; on the accepting side the first message too
  bool closed_ = false;
  Clock::time_point heard_ = Clock::now();
  uint64_t received_ = 0;
  std::atomic<uint64_t> queued_{0};
  Clock::time_point taken_since_ = Clock::now();
  std::function<void()> on_sent_;
};

/// Stream is tcp::socket or TlsStream; the latter adds a handshake at the start and a notification at the
/// end.
template <class Stream>
class StreamConnection final : public PeerRecord {
  static constexpr bool kTls = std::is_same_v<Stream, TlsStream>;

 public:
  StreamConnection(tcp::socket socket, Security security, std::string host,
                   std::shared_ptr<IncomingBudget> budget)
      : PeerRecord(std::move(host)),
        stream_(MakeStream<Stream>(std::move(socket), security)),
        security_(std::move(security)),
        budget_(std::move(budget)),
        deadline_(stream_.get_executor()) {
    ErrorCode ignored;
    stream_.lowest_layer().set_option(tcp::no_delay(true), ignored);
    KeepAlive(stream_.lowest_layer().native_handle());
    const auto remote = stream_.lowest_layer().remote_endpoint(ignored);
    peer_ = ignored ? "?" : EndpointText(remote);
  }
  ~StreamConnection() override {
    if (budget_) budget_->GiveBack(*this);
  }

  void Start(OnMessage on_message, OnClose on_close) override {
    on_message_ = std::move(on_message);
    on_close_ = std::move(on_close);
    asio::post(stream_.get_executor(), [self = Self()] {
      if (self->closed_) return;
      self->SetDeadline(kOpeningTime);
      if constexpr (kTls) {
        self->Handshake();
      } else {
        self->Greet();
      }
    });
  }

  void Send(Message message) override {
    const uint64_t bytes = kFrameHeaderBytes + message.table.size() + message.raw.size();
    queued_ += bytes;
    asio::post(stream_.get_executor(), [self = Self(), bytes, message = std::move(message)]() mutable {
      if (self->closed_ || self->closing_ || self->cannot_write_) {
        self->queued_ -= bytes;
        return;
      }
      Bytes head = EncodeFrameHeader(message);
      head.insert(head.end(), message.table.begin(), message.table.end());
      self->Queue(std::move(head));
      if (!message.raw.empty()) self->Queue(std::move(message.raw));
      self->WriteSoon();
    });
  }

  void Close() override {
    close_asked_ = true;
    asio::post(stream_.get_executor(), [self = Self(), release = Release(Self())] {
      if (self->closed_ || self->closing_) return;
      self->closing_ = true;
      self->SetDeadline(kClosingTime);
      if (!self->writing_ && self->outgoing_.empty()) self->SayFarewell();
    });
  }

  void Drop(std::string message, bool permanent) override {
    if (closed_) return;
    Shut();
    if (budget_) budget_->GiveBack(*this);
    outgoing_.clear();
    // Moved out first: the handler may release this connection.
    OnClose handler = std::move(on_close_);
    on_close_ = nullptr;
    on_message_ = nullptr;
    on_sent_ = nullptr;
    if (handler && !close_asked_)
      handler(Error{fmt::format("{} {}", peer_, message),
                    permanent ? ErrorKind::kPermanent : ErrorKind::kFailed});
  }

  void Watch(Clock::time_point now) override {
    if (closed_ || closing_ || !greeted_) return;
    const auto rate_time = std::chrono::seconds(
        (uint64_t{incoming_header_.table_bytes} + incoming_header_.raw_bytes) / kLeastBytesPerS);
    if (reading_message_ && now - message_since_ > kMessageTime + rate_time)
      return Drop("is dropped: one of its messages stayed incomplete for too long", false);
    if (now - heard_ > kIdleTime)
      return Drop(fmt::format("is dropped: idle for {} seconds", kIdleTime.count()), false);
    const uint64_t taken = taken_bytes();
    if (queued_ == 0 || std::exchange(taken_, taken) != taken) taken_since_ = now;
    if (now - taken_since_ > kUnreadTime)
      Drop("is dropped: it does not read the answers to its requests", false);
  }
  uint64_t taken_bytes() const override {
    int unacknowledged = 0;
    if (closed_ || ::ioctl(SocketNumber(), SIOCOUTQ, &unacknowledged) != 0) return written_;
    return written_ - std::min<uint64_t>(written_, static_cast<uint64_t>(std::max(0, unacknowledged)));
  }
  std::string local_host() const override {
    ErrorCode ignored;
    return stream_.lowest_layer().local_endpoint(ignored).address().to_string();
  }

 private:
  std::shared_ptr<StreamConnection> Self() {
    return std::static_pointer_cast<StreamConnection>(shared_from_this());
  }
  tcp::socket& Socket() {
    if constexpr (kTls)
      return stream_.next_layer();
    else
      return stream_;
  }
  int SocketNumber() const {
    return const_cast<StreamConnection*>(this)->stream_.lowest_layer().native_handle();
  }

  /// Clears the callbacks when destroyed; they may own this connection's owner. It is part of a posted
  /// handler, so it also runs when the io_context ends before the handler is called.
  class Release {
   public:
    explicit Release(std::shared_ptr<StreamConnection> connection) : connection_(std::move(connection)) {}
    Release(Release&&) = default;
    ~Release() {
      if (!connection_) return;
      connection_->on_message_ = nullptr;
      connection_->on_close_ = nullptr;
      connection_->on_sent_ = nullptr;
    }

   private:
    std::shared_ptr<StreamConnection> connection_;
  };

  /// Starts the time limit of the present phase. Before the greeting: the peer is dropped. After Close():
  /// messages still queued are dropped. After a failed write: ends the wait for the peer's last words.
  void SetDeadline(std::chrono::seconds time) {
    deadline_.expires_after(time);
    deadline_.async_wait([self = Self()](const ErrorCode& error) {
      if (error || (self->greeted_ && !self->closing_ && !self->cannot_write_)) return;
      self->Drop("does not answer", false);
    });
  }

  void SetGreeted() {
    if (std::exchange(greeted_, true) || closing_ || cannot_write_) return;
    deadline_.cancel();
  }

  void Shut() {
    closed_ = true;
    deadline_.cancel();
    ErrorCode ignored;
    stream_.lowest_layer().shutdown(tcp::socket::shutdown_both, ignored);
    stream_.lowest_layer().close(ignored);
  }

  /// Closes after the last write; TLS sends its close notification first. Incoming bytes are read until the
  /// peer closes too: closing a socket with unread bytes discards data on its way to the peer.
  void SayFarewell() {
    if (!ready_) return Shut();
    parting_ = true;
    SetDeadline(kNotifyTime);
    if constexpr (kTls)
      stream_.async_shutdown([self = Self()](const ErrorCode&) { self->EndSending(); });
    else
      EndSending();
  }

  void EndSending() {
    if (closed_) return;
    ErrorCode ignored;
    stream_.lowest_layer().shutdown(tcp::socket::shutdown_send, ignored);
    ReadRest();
  }

  void ReadRest() {
    Socket().async_read_some(asio::buffer(rest_), [self = Self()](const ErrorCode& error, size_t) {
      if (self->closed_) return;
      if (error) return self->Shut();
      self->ReadRest();
    });
  }

  void DropOn(const ErrorCode& error) {
    if (parting_) return;
    if (error == asio::error::eof || error == asio::error::connection_reset ||
        error == asio::error::broken_pipe || error == asio::ssl::error::stream_truncated)
      return Drop("closed the connection", false);
    if constexpr (kTls) {
      // TLS 1.3: a client learns of a refused client certificate only after its own handshake.
      if (!greeted_ && error.category() == asio::error::get_ssl_category()) return DropOnHandshake(error);
    }
    Drop(fmt::format("is lost: {}", error.message()), false);
  }

  // --- opening

  void Handshake() {
    const auto side = accepted() ? asio::ssl::stream_base::server : asio::ssl::stream_base::client;
    if (!accepted()) security_.ExpectHost(stream_.native_handle(), host_);
    stream_.async_handshake(side, [self = Self()](const ErrorCode& error) {
      if (self->closed_) return;
      if (error) return self->DropOn(error);
      if (!self->security_.Proved(self->stream_.native_handle()))
        return self->Drop("has finished the TLS handshake without a secret or certificate", true);
      self->Greet();
    });
  }

  void DropOnHandshake(const ErrorCode& error) {
    const auto code = static_cast<uint32_t>(error.value());
    // OpenSSL answers nothing to a peer without TLS. This alert lets a Quarry program report the reason.
    // fatal, protocol_version (RFC 8446, section 6)
    constexpr std::array<unsigned char, 7> kAlert = {0x15, 3, 3, 0, 2, 2, 70};
    ErrorCode ignored;
    if (accepted() && Security::IsNotTls(code)) stream_.next_layer().send(asio::buffer(kAlert), 0, ignored);
    Drop(security_.Explain(stream_.native_handle(), code), true);
  }

  void Greet() {
    ready_ = true;
    outgoing_.push_front(EncodePreamble());
    WriteNext();
    asio::async_read(stream_, asio::buffer(preamble_), [self = Self()](const ErrorCode& error, size_t n) {
      if (self->closed_) return;
      if (!kTls && IsTlsRecord(std::span(self->preamble_).first(n)))
        return self->Drop(
            self->accepted()
                ? "speaks TLS; this side was started without --secret-file or certificates"
                : "asks for TLS; give --secret-file, or --tls-ca, --tls-cert and --tls-key, as it "
                  "was started with",
            true);
      if (error) return self->DropOn(error);
      if (const Status status = CheckPreamble(self->preamble_); !status)
        return self->Drop(fmt::format("cannot be understood: {}", status.error().message), true);
      if (!self->accepted()) self->SetGreeted();
      self->ReadHeader();
    });
  }

  // --- reading

  void ReadHeader() {
    asio::async_read(stream_, asio::buffer(header_), [self = Self()](const ErrorCode& error, size_t n) {
      if (error) return self->DropOn(error);
      self->Heard(n);
      const auto header = DecodeFrameHeader(self->header_, self->speaker_);
      if (!header) return self->Drop(fmt::format("cannot be understood: {}", header.error().message), false);
      if (header->raw_bytes > self->most_raw_bytes_)
        return self->Drop("cannot be understood: received a message larger than requested", false);
      self->incoming_ = {header->type, header->request, {}, {}};
      self->incoming_header_ = *header;
      self->have_ = 0;
      self->in_raw_ = false;
      self->reading_message_ = true;
      self->message_since_ = self->heard_;
      self->ReadPart();
    });
  }

  /// Reads the table, then the raw part, as far as bytes arrive. A claimed size alone reserves no memory.
  void ReadPart() {
    Bytes& part = in_raw_ ? incoming_.raw : incoming_.table;
    const size_t whole = in_raw_ ? incoming_header_.raw_bytes : incoming_header_.table_bytes;
    if (have_ == whole) {
      if (std::exchange(in_raw_, true)) return Deliver();
      have_ = 0;
      return ReadPart();
    }
    if (have_ == part.size() && !Grow(part, whole)) return;
    stream_.async_read_some(asio::buffer(part.data() + have_, part.size() - have_),
                            [self = Self()](const ErrorCode& error, size_t n) {
                              if (error) return self->DropHalfRead(error);
                              self->Heard(n);
                              self->have_ += n;
                              self->ReadPart();
                            });
  }

  /// Whoever holds the connection on does not hold its message.
  void DropHalfRead(const ErrorCode& error) {
    incoming_ = {};
    DropOn(error);
  }

  /// Enlarges `part` by one step. Returns: false when the memory budget is exhausted; the connection is
  /// dropped.
  bool Grow(Bytes& part, size_t whole) {
    constexpr size_t kReserved = 16 << 20;
    const size_t step =
        accepted() ? std::min(kLargestStep, std::max(kFirstStep, 3 * part.size())) : kTrustedStep;
    const size_t size = std::min(whole, part.size() + step);
    if (budget_ && !budget_->Take(*this, size - part.size())) {
      incoming_ = {};
      Drop("is dropped: incomplete messages of all connections take too much memory", false);
      return false;
    }
    // Reserved pages cost no memory until they are written, and reserving avoids copies later.
    if (part.size() >= kTrustedStep && part.capacity() < size)
      part.reserve(std::min(whole, std::max(kReserved, 2 * part.size())));
    part.resize(size);
    return true;
  }

  void Deliver() {
    if (const Status status = CheckContent(incoming_header_, incoming_); !status)
      return Drop(fmt::format("cannot be understood: {}", status.error().message), false);
    SetGreeted();
    reading_message_ = false;
    // the receiver may have narrowed it with Expect()
    if (speaker_ == Speaker::kStranger) speaker_ = Speaker::kAnyone;
    if (on_message_ && !close_asked_) on_message_(std::exchange(incoming_, {}));
    if (budget_) budget_->GiveBack(*this);
    if (!closed_ && !closing_) ReadHeader();
  }

  // --- writing

  /// Joins small parts up to 64 KiB: a system call costs more than the copy.
  void Queue(Bytes part) {
    constexpr size_t kTogether = 64 << 10;
    const bool may_grow = outgoing_.size() > (writing_ ? 1u : 0u);
    if (may_grow && outgoing_.back().size() + part.size() <= kTogether)
      outgoing_.back().insert(outgoing_.back().end(), part.begin(), part.end());
    else
      outgoing_.push_back(std::move(part));
  }

  /// Writes after the handlers that are already posted, so that messages of one turn go out together.
  void WriteSoon() {
    if (writing_ || std::exchange(write_planned_, true)) return;
    asio::post(stream_.get_executor(), [self = Self()] {
      self->write_planned_ = false;
      if (!self->writing_) self->WriteNext();
    });
  }

  /// Ends writing for good and drops the queue.
  void StopWriting() {
    cannot_write_ = true;
    for (const Bytes& part : outgoing_) queued_ -= std::min<uint64_t>(queued_, part.size());
    outgoing_.clear();
    SetDeadline(kNotifyTime);
  }

  void WriteNext() {
    if (!ready_ || closed_ || cannot_write_ || outgoing_.empty()) return;
    writing_ = true;
    asio::async_write(stream_, asio::buffer(outgoing_.front()),
                      [self = Self()](const ErrorCode& error, size_t n) {
                        self->writing_ = false;
                        if (self->closed_) return;
                        // The peer may have sent the reason before closing: reading goes on and reports it.
                        if (error && !self->closing_) return self->StopWriting();
                        if (error) return self->DropOn(error);
                        self->written_ += n;
                        self->queued_ -= std::min<uint64_t>(self->queued_, n);
                        self->outgoing_.pop_front();
                        if (self->outgoing_.empty() && self->closing_) return self->SayFarewell();
                        self->WriteNext();
                        if (self->on_sent_) self->on_sent_();
                      });
  }

  Stream stream_;
  const Security security_;
  const std::shared_ptr<IncomingBudget> budget_;  ///< null on the connecting side
  asio::steady_timer deadline_;
  OnMessage on_message_;
  OnClose on_close_;
  std::array<std::byte, kPreambleBytes> preamble_{};
  std::array<std::byte, kFrameHeaderBytes> header_{};
  Message incoming_;
  FrameHeader incoming_header_{};
  size_t have_ = 0;      ///< bytes received of the part being read
  bool in_raw_ = false;  ///< the part being read is the raw part
  bool reading_message_ = false;
  Clock::time_point message_since_;
  uint64_t written_ = 0;  ///< bytes handed to the system
  uint64_t taken_ = 0;    ///< taken_bytes() at the last Watch()
  std::deque<Bytes> outgoing_;
  std::atomic<bool> close_asked_{false};  ///< Close() was called: no more callbacks
  bool ready_ = false;                    ///< the handshake is over, writing may begin
  std::array<std::byte, 4096> rest_;      ///< receives bytes that are dropped after closing
  bool write_planned_ = false, writing_ = false, cannot_write_ = false;
  bool closing_ = false, parting_ = false;
};

}  // namespace

std::shared_ptr<AcceptedConnection> MakeConnection(asio::io_context& io, int socket, const Security& security,
                                                   const std::string& host,
                                                   std::shared_ptr<IncomingBudget> budget) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  const bool v6 = ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
                  address.ss_family == AF_INET6;
  tcp::socket stream(io, v6 ? tcp::v6() : tcp::v4(), socket);
  if (security.tls())
    return std::make_shared<StreamConnection<TlsStream>>(std::move(stream), security, host,
                                                         std::move(budget));
  return std::make_shared<StreamConnection<tcp::socket>>(std::move(stream), security, host,
                                                         std::move(budget));
}

}  // namespace quarry
