// Longer than other files: one class, whose reading, writing, beginning and end share all of its state.
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

constexpr auto kOpeningTime = std::chrono::seconds(10);  // for handshake, preamble and greeting together
constexpr auto kClosingTime = std::chrono::seconds(10);  // for what is queued
constexpr auto kNotifyTime = std::chrono::seconds(1);    // for the other side to close too
/// At the side that has accepted. A half-read message has this long, and as long as its bytes take at the
/// slowest rate of a link that is still of use; chaos tests trickle slower, for eleven seconds at most.
constexpr auto kMessageTime = std::chrono::seconds(30);
constexpr uint64_t kLeastBytesPerS = 16 << 10;
/// Without a byte; all of Quarry's own programs ping more often.
constexpr auto kIdleTime = std::chrono::seconds(60);
/// Without anything taken of what is queued; a process that is stopped is taken for dead earlier.
constexpr auto kUnreadTime = std::chrono::seconds(10);
/// Memory for a message grows with the bytes that have come: at first by this, then fourfold, then by the
/// other at a time. Small steps keep connections that send much from holding up those that send little. The
/// side that has connected knows whom it asked.
constexpr size_t kFirstStep = 16 << 10, kLargestStep = 64 << 10, kTrustedStep = 1 << 20;

using TlsStream = asio::ssl::stream<tcp::socket>;

std::string EndpointText(const tcp::endpoint& e) {
  const std::string host = e.address().to_string();
  return e.address().is_v6() ? fmt::format("[{}]:{}", host, e.port()) : fmt::format("{}:{}", host, e.port());
}

/// A peer that vanishes without a farewell (its machine, the way to it) is noticed in half a minute, also
/// where nothing is ever sent to it unasked.
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

/// A TLS record where a preamble should be: an alert or a handshake.
bool IsTlsRecord(std::span<const std::byte> bytes) {
  return bytes.size() >= 2 && (bytes[0] == std::byte{0x15} || bytes[0] == std::byte{0x16}) &&
         bytes[1] == std::byte{3};
}

/// Stream: tcp::socket, or TlsStream, which differs in the handshake at its start and the farewell at its
/// end. `host`: whom a client wants to reach; empty at the side that has accepted.
template <class Stream>
class StreamConnection final : public AcceptedConnection {
  static constexpr bool kTls = std::is_same_v<Stream, TlsStream>;

 public:
  StreamConnection(tcp::socket socket, Security security, std::string host,
                   std::shared_ptr<IncomingBudget> budget)
      : stream_(MakeStream<Stream>(std::move(socket), security)),
        security_(std::move(security)),
        host_(std::move(host)),
        budget_(std::move(budget)),
        speaker_(accepted() ? Speaker::kStranger : Speaker::kAnyone),
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

  void Expect(Speaker speaker, uint32_t most_raw_bytes) override {
    speaker_ = speaker;
    most_raw_bytes_ = most_raw_bytes;
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
    // Moved out first: the handler may let go of this connection.
    OnClose handler = std::move(on_close_);
    on_close_ = nullptr;
    on_message_ = nullptr;
    on_sent_ = nullptr;
    if (handler && !close_asked_)
      handler(Error{fmt::format("{} {}", peer_, message),
                    permanent ? ErrorKind::kPermanent : ErrorKind::kFailed});
  }

  bool newcomer() const override { return !closed_ && !greeted_; }
  bool closed() const override { return closed_; }
  bool fetches() const override { return speaker_ == Speaker::kVoxels; }
  Clock::time_point heard() const override { return heard_; }
  void Watch(Clock::time_point now) override {
    if (closed_ || closing_ || !greeted_) return;
    const auto rate_time = std::chrono::seconds(
        (uint64_t{incoming_header_.table_bytes} + incoming_header_.raw_bytes) / kLeastBytesPerS);
    if (reading_message_ && now - message_since_ > kMessageTime + rate_time)
      return Drop("is dropped: a message of its has stayed half-read for too long", false);
    if (now - heard_ > kIdleTime)
      return Drop(fmt::format("is dropped: idle for {} seconds", kIdleTime.count()), false);
    const uint64_t taken = taken_bytes();
    if (queued_ == 0 || std::exchange(taken_, taken) != taken) taken_since_ = now;
    if (now - taken_since_ > kUnreadTime) Drop("is dropped: it does not read what it asked for", false);
  }
  uint64_t queued_bytes() const override { return queued_; }
  uint64_t taken_bytes() const override {
    int unacknowledged = 0;
    if (closed_ || ::ioctl(SocketNumber(), SIOCOUTQ, &unacknowledged) != 0) return written_;
    return written_ - std::min<uint64_t>(written_, static_cast<uint64_t>(std::max(0, unacknowledged)));
  }
  double unread_s() const override {
    return queued_ == 0 ? 0 : std::chrono::duration<double>(Clock::now() - taken_since_).count();
  }
  void SetOnSent(std::function<void()> on_sent) override { on_sent_ = std::move(on_sent); }
  uint64_t received_bytes() const override { return received_; }
  std::string local_host() const override {
    ErrorCode ignored;
    return stream_.lowest_layer().local_endpoint(ignored).address().to_string();
  }
  const std::string& peer() const override { return peer_; }

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
  bool accepted() const { return host_.empty(); }

  /// Lets go of the callbacks at its end: they may hold what holds this connection. Part of a handler, so
  /// that it also happens when the io_context ends before the handler's turn.
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

  /// Until the greeting: the other side is dropped. After Close: what is not sent by then is not sent. When
  /// nothing can be written any more: the other side has said nothing more.
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

  /// Everything is sent; a TLS connection tells so. What still comes is read until the other side has closed
  /// too: a socket closed with bytes unread takes back what is on its way.
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
      // A client learns here, after its own handshake, that the server does not take its certificate.
      if (!greeted_ && error.category() == asio::error::get_ssl_category()) return DropOnHandshake(error);
    }
    Drop(fmt::format("is lost: {}", error.message()), false);
  }

  // --- the beginning

  void Handshake() {
    const auto side = accepted() ? asio::ssl::stream_base::server : asio::ssl::stream_base::client;
    if (!accepted()) security_.ExpectHost(stream_.native_handle(), host_);
    stream_.async_handshake(side, [self = Self()](const ErrorCode& error) {
      if (self->closed_) return;
      if (error) return self->DropOn(error);
      if (!self->security_.Proved(self->stream_.native_handle()))
        return self->Drop("has finished the TLS handshake without proving itself", true);
      self->Greet();
    });
  }

  void DropOnHandshake(const ErrorCode& error) {
    const auto code = static_cast<uint32_t>(error.value());
    // OpenSSL says nothing to who does not speak TLS; a person at a Quarry program without it should know
    // why.
    constexpr std::array<unsigned char, 7> kAlert = {0x15, 3, 3, 0, 2, 2, 70};  // fatal, protocol version
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
        return self->Drop("cannot be understood: received a message larger than was asked for", false);
      self->incoming_ = {header->type, header->request, {}, {}};
      self->incoming_header_ = *header;
      self->have_ = 0;
      self->in_raw_ = false;
      self->reading_message_ = true;
      self->message_since_ = self->heard_;
      self->ReadPart();
    });
  }

  void Heard(size_t bytes) {
    received_ += bytes;
    heard_ = Clock::now();
  }

  /// The table, then the raw bytes. A claimed size alone costs nothing.
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
                              if (error) return self->DropOn(error);
                              self->Heard(n);
                              self->have_ += n;
                              self->ReadPart();
                            });
  }

  /// False: there is no memory for it, and the connection is dropped.
  bool Grow(Bytes& part, size_t whole) {
    constexpr size_t kReserved = 16 << 20;
    const size_t step =
        accepted() ? std::min(kLargestStep, std::max(kFirstStep, 3 * part.size())) : kTrustedStep;
    const size_t size = std::min(whole, part.size() + step);
    if (budget_ && !budget_->Take(*this, size - part.size())) {
      Drop("is dropped: half-read messages of all connections take too much memory", false);
      return false;
    }
    // Pages that nothing has been written to are no memory yet, and nothing is copied again.
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
    if (speaker_ == Speaker::kStranger) speaker_ = Speaker::kAnyone;  // unless the receiver says who it is
    if (on_message_ && !close_asked_) on_message_(std::exchange(incoming_, {}));
    if (budget_) budget_->GiveBack(*this);
    if (!closed_ && !closing_) ReadHeader();
  }

  // --- writing

  /// Small parts go out together: a call of the system takes longer than copying them.
  void Queue(Bytes part) {
    constexpr size_t kTogether = 64 << 10;
    const bool may_grow = outgoing_.size() > (writing_ ? 1u : 0u);
    if (may_grow && outgoing_.back().size() + part.size() <= kTogether)
      outgoing_.back().insert(outgoing_.back().end(), part.begin(), part.end());
    else
      outgoing_.push_back(std::move(part));
  }

  /// When what else has been asked for in this turn is queued as well.
  void WriteSoon() {
    if (writing_ || std::exchange(write_planned_, true)) return;
    asio::post(stream_.get_executor(), [self = Self()] {
      self->write_planned_ = false;
      if (!self->writing_) self->WriteNext();
    });
  }

  /// For good; what is queued goes nowhere any more.
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
                        // Who does not want this side any more may have said why: reading tells, and ends.
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
  const std::string host_;
  const std::shared_ptr<IncomingBudget> budget_;  ///< null at the side that has connected
  Speaker speaker_;
  uint32_t most_raw_bytes_ = ~uint32_t{0};
  asio::steady_timer deadline_;
  std::string peer_;
  OnMessage on_message_;
  OnClose on_close_;
  std::array<std::byte, kPreambleBytes> preamble_{};
  std::array<std::byte, kFrameHeaderBytes> header_{};
  Message incoming_;
  FrameHeader incoming_header_{};
  size_t have_ = 0;      ///< bytes of the part that is being read
  bool in_raw_ = false;  ///< that part
  bool reading_message_ = false;
  Clock::time_point message_since_, heard_ = Clock::now();
  uint64_t received_ = 0;
  uint64_t written_ = 0;  ///< bytes handed to the system
  uint64_t taken_ = 0;    ///< of those, that had been taken when it was looked last
  Clock::time_point taken_since_ = Clock::now();
  std::function<void()> on_sent_;
  std::deque<Bytes> outgoing_;
  std::atomic<uint64_t> queued_{0};
  std::atomic<bool> close_asked_{false};  ///< what has come already is not told any more
  bool ready_ = false;                    ///< past the handshake: bytes may go out
  bool greeted_ = false;  ///< the preamble has come; at the side that accepted, the first message too
  std::array<std::byte, 4096> rest_;  ///< of what comes when nobody listens any more
  bool write_planned_ = false, writing_ = false, cannot_write_ = false;
  bool closing_ = false, parting_ = false, closed_ = false;
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
