// Long: one class serves a connection from opening to closing, and all steps share its state.

#include "common/remote/http_client.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <deque>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/version.h"
#include "common/remote/http_answer.h"
#include "common/remote/http_proxy.h"
#include "common/remote/http_trust.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using Clock = std::chrono::steady_clock;
using ErrorCode = boost::system::error_code;

// Limits the memory for a head, which a server could make endless.
constexpr uint32_t kMaxHeadBytes = 8 << 10;
constexpr size_t kBufferBytes = 64 << 10;
constexpr uint64_t kStallBytes = 4 << 10;  // bytes; a transfer with less in stall_s has stalled
// Bytes at the beginning of a refusal's body in which its code is looked for.
constexpr size_t kRefusalBytes = 1 << 10;
constexpr int kMostRedirections = 5;
// a connection idle for longer is replaced: servers close idle connections
constexpr auto kKeepIdle = std::chrono::seconds(30);
constexpr double kRefusalS = 2;  // limit for the beginning of a refusal's body

bool IsAddress(const std::string& host) {
  ErrorCode error;
  asio::ip::make_address(host, error);
  return !error;
}

struct Job {
  uint64_t offset = 0;
  uint32_t size = 0;
  HttpRangeClient::Done done;
  bool again = false;    // failed once on a stale connection
  bool anew = false;     // was refused where it had been sent to, and begins at the file's own address again
  int redirections = 0;  // followed since
};

}  // namespace

struct HttpRangeClient::Pool : std::enable_shared_from_this<HttpRangeClient::Pool> {
  Pool(asio::io_context& context, HttpLocation place, HttpOptions how)
      : io(context), location(std::move(place)), options(std::move(how)), name(location.text()) {
    if (!options.now) options.now = [] { return std::time(nullptr); };
    where = location;
    if (location.tls) setup = PrepareTls();
  }

  /// Makes the TLS context, at the first address that needs it.
  Status PrepareTls() {
    if (tls) return {};
    asio::ssl::context context(asio::ssl::context::tls_client);
    SSL_CTX_set_min_proto_version(context.native_handle(), TLS1_2_VERSION);
    context.set_verify_mode(asio::ssl::verify_peer);
    QUARRY_TRY(UseAuthorities(context.native_handle(), options));
    tls.emplace(std::move(context));
    return {};
  }

  void Pump();
  void Stop();
  std::shared_ptr<Lane> NewLane();
  void Idle(std::shared_ptr<Lane> lane);
  void Remove(const Lane* lane);
  /// Repeats `job` at the address `to`, where the file was said to be.
  void Redirect(Job job, HttpLocation to);
  /// Repeats `job` at the file's own address: where it had been sent to, it was refused.
  void Anew(Job job);
  /// Repeats `job` on a new connection. The server had closed its connection, and so probably all idle ones.
  void Again(Job job);

  asio::io_context& io;
  HttpLocation location;  // the file's own address
  HttpLocation where;     // where it is, after redirections
  HttpOptions options;
  std::string name;
  std::optional<asio::ssl::context> tls;
  Status setup;
  std::deque<Job> queue;
  std::vector<std::shared_ptr<Lane>> lanes, idle;  // idle: last used at the end
  Counters counters;
  bool stopped = false;
};

/// One connection, from opening to closing, with one request at a time.
class HttpRangeClient::Lane : public std::enable_shared_from_this<HttpRangeClient::Lane> {
 public:
  explicit Lane(std::shared_ptr<Pool> pool)
      : pool_(std::move(pool)),
        resolver_(pool_->io),
        timer_(pool_->io),
        buffer_(kBufferBytes),
        location_(pool_->where) {
    buffer_.reserve(kBufferBytes / 2);
    if (location_.tls)
      tls_.emplace(pool_->io, *pool_->tls);
    else
      plain_.emplace(pool_->io);
  }

  /// Whether requests to `where` can go over this connection.
  bool Leads(const HttpLocation& where) const { return SameServer(location_, where); }

  void Start(Job job) {
    job_ = std::move(job);
    location_ = pool_->where;
    if (connected_) return SendRequest();
    Arm(pool_->options.connect_s, "cannot be reached: no answer");
    auto proxy = ProxyFor(location_);
    if (!proxy) return FailLater(proxy.error().message);
    proxy_ = std::move(*proxy);
    resolver_.async_resolve(
        proxy_ ? proxy_->host : location_.host, std::to_string(proxy_ ? proxy_->port : location_.port),
        [self = shared_from_this()](const ErrorCode& error, tcp::resolver::results_type found) {
          if (self->closed_) return;
          if (error) return self->Fail(self->Unreachable(error));
          self->Connect(found);
        });
  }

  void Close() {
    closed_ = true;
    Disarm();
    try {
      resolver_.cancel();
    } catch (const std::bad_alloc&) {  // its handler finds closed_
    }
    ErrorCode ignored;
    socket().close(ignored);
    job_ = {};
  }

  Clock::time_point idle_since;

 private:
  /// Whether the request goes to another address than the file's own.
  bool Elsewhere() const {
    return !SameServer(location_, pool_->location) || location_.target != pool_->location.target;
  }
  /// As Fail(), not from within Get().
  void FailLater(std::string sentence) {
    asio::post(pool_->io, [self = shared_from_this(), sentence = std::move(sentence)] {
      if (!self->closed_) self->Fail(sentence, true);
    });
  }
  std::string Unreachable(const ErrorCode& error) const {
    return proxy_ ? fmt::format("its proxy {}:{} cannot be reached: {}", proxy_->host, proxy_->port,
                                error.message())
                  : "cannot be reached: " + error.message();
  }
  tcp::socket& socket() { return tls_ ? tls_->next_layer() : *plain_; }
  template <class Use>
  void WithStream(Use&& use) {
    if (tls_)
      use(*tls_);
    else
      use(*plain_);
  }

  /// Fails the request with `sentence` after `seconds`, unless Arm() or Disarm() is called before.
  void Arm(double seconds, const char* sentence) {
    const uint64_t generation = ++generation_;
    timer_.expires_after(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds)));
    timer_.async_wait([self = shared_from_this(), generation, sentence](const ErrorCode& error) {
      if (error || generation != self->generation_) return;
      if (self->refusal_ != 0) return self->FailRefused();
      self->Fail(sentence);
    });
  }
  void Disarm() {
    ++generation_;
    timer_.cancel();
  }

  void Connect(const tcp::resolver::results_type& found) {
    asio::async_connect(socket(), found,
                        [self = shared_from_this()](const ErrorCode& error, const tcp::endpoint&) {
                          if (self->closed_) return;
                          if (error) return self->Fail(self->Unreachable(error));
                          ErrorCode ignored;
                          self->socket().set_option(tcp::no_delay(true), ignored);
                          ++self->pool_->counters.connections;
                          if (self->tls_) return self->proxy_ ? self->OpenTunnel() : self->Handshake();
                          self->connected_ = true;
                          self->SendRequest();
                        });
  }

  /// Asks the proxy for a connection to the server, which then carries TLS.
  void OpenTunnel() {
    const std::string target = fmt::format(
        "{}:{}", location_.host.find(':') == std::string::npos ? location_.host : "[" + location_.host + "]",
        location_.port);
    request_ = {http::verb::connect, target, 11};
    request_.set(http::field::host, target);
    if (!proxy_->authorization.empty()) request_.set(http::field::proxy_authorization, proxy_->authorization);
    tunnel_.emplace();
    tunnel_->header_limit(kMaxHeadBytes);
    tunnel_->skip(true);  // a tunnel's answer has no body
    http::async_write(socket(), request_, [self = shared_from_this()](const ErrorCode& error, size_t) {
      if (self->closed_) return;
      if (error) return self->Fail("its proxy ends the connection: " + error.message());
      http::async_read_header(
          self->socket(), self->buffer_, *self->tunnel_, [self](const ErrorCode& failed, size_t) {
            if (self->closed_) return;
            if (failed) return self->Fail("its proxy gives no answer: " + failed.message());
            const unsigned status = self->tunnel_->get().result_int();
            if (status / 100 != 2)
              return self->Fail("its proxy " + StatusSentence(status, ""), IsPermanentStatus(status));
            if (self->buffer_.size() > 0) return self->Fail("its proxy does not speak TLS");
            self->Handshake();
          });
    });
  }

  void Handshake() {
    const std::string& host = location_.host;
    SSL* const ssl = tls_->native_handle();
    bool named;
    if (IsAddress(host)) {
      named = X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(ssl), host.c_str()) == 1;
    } else {
      named = SSL_set1_host(ssl, host.c_str()) == 1 && SSL_set_tlsext_host_name(ssl, host.c_str()) == 1;
    }
    if (!named) return Fail("no TLS: its name cannot be verified");
    tls_->async_handshake(asio::ssl::stream_base::client,
                          [self = shared_from_this()](const ErrorCode& error) {
                            if (self->closed_) return;
                            if (error) return self->FailHandshake(error);
                            self->connected_ = true;
                            self->SendRequest();
                          });
  }

  void FailHandshake(const ErrorCode& error) {
    const long verified = SSL_get_verify_result(tls_->native_handle());
    const bool certificate =
        error.category() == asio::error::get_ssl_category() &&
        ERR_GET_REASON(static_cast<unsigned long>(error.value())) == SSL_R_CERTIFICATE_VERIFY_FAILED;
    if (!certificate) return Fail("no TLS: " + error.message());
    const bool other = verified == X509_V_ERR_HOSTNAME_MISMATCH || verified == X509_V_ERR_IP_ADDRESS_MISMATCH;
    Fail(other ? fmt::format("its certificate is not for {}", location_.host)
               : fmt::format("its certificate is not trusted: {} ({})",
                             X509_verify_cert_error_string(verified), AuthorityAdvice(pool_->options)),
         true);
  }

  void SendRequest() {
    const std::string range = fmt::format("bytes={}-{}", job_.offset, job_.offset + job_.size - 1);
    const bool whole = proxy_ && !tls_;  // a proxy is given the whole address
    request_ = {http::verb::get, (whole ? "http://" + location_.authority() : "") + location_.target, 11};
    request_.set(http::field::host, location_.authority());
    if (whole && !proxy_->authorization.empty())
      request_.set(http::field::proxy_authorization, proxy_->authorization);
    request_.set(http::field::range, range);
    request_.set(http::field::accept_encoding, "identity");
    request_.set(http::field::user_agent, std::string("quarry/") + kVersion);
    if (SameServer(location_, pool_->location)) {  // another server gets no secret
      for (const HttpHeader& h : pool_->options.headers) request_.set(h.name, h.value);
      if (pool_->options.aws) Sign(range);
    }
    ++pool_->counters.requests;
    // The timer covers writing too: the server may answer or close before it has read the whole request.
    Arm(pool_->options.first_byte_s, "does not answer a request");
    parser_.emplace();
    parser_->header_limit(kMaxHeadBytes);
    parser_->body_limit(std::numeric_limits<uint64_t>::max());  // the span to be filled is the limit
    WithStream([this](auto& stream) {
      http::async_write(stream, request_, [self = shared_from_this()](const ErrorCode& error, size_t) {
        if (self->closed_) return;
        if (error) return self->FailRead(error);
        self->ReadHead();
      });
    });
  }

  void Sign(const std::string& range) {
    AwsRequest signing{location_.authority(), location_.target, {{"range", range}}};
    for (const HttpHeader& h : pool_->options.headers)
      if (boost::beast::iequals(h.name.substr(0, 6), "x-amz-")) signing.headers.push_back(h);
    for (const HttpHeader& h : SignAwsRequest(signing, *pool_->options.aws, pool_->options.now()))
      request_.set(h.name, h.value);
  }

  void ReadHead() {
    WithStream([this](auto& stream) {
      http::async_read_header(stream, buffer_, *parser_,
                              [self = shared_from_this()](const ErrorCode& error, size_t) {
                                if (self->closed_) return;
                                if (error) return self->FailRead(error);
                                self->OnHead();
                              });
    });
  }

  void OnHead() {
    const auto& head = parser_->get();
    const auto field = [&](http::field name) {
      const auto value = head[name];
      return std::string_view(value.data(), value.size());
    };
    const unsigned status = head.result_int();
    if (IsRedirection(status) && !field(http::field::location).empty())
      return Redirected(field(http::field::location));
    if (status != 206) return ReadRefusal(status);
    const auto range = DecodeContentRange(field(http::field::content_range));
    const auto length = parser_->content_length();
    if (!range || range->first != job_.offset || range->last != job_.offset + job_.size - 1 ||
        (length && *length != job_.size))
      return Fail(fmt::format("answers with another range than bytes {}-{}", job_.offset,
                              job_.offset + job_.size - 1));
    const std::string_view encoding = field(http::field::content_encoding);
    if (!encoding.empty() && encoding != "identity")
      return Fail("serves the file encoded, not as it is", true);
    reply_ = {Bytes(job_.size), range->file_size};
    parser_->get().body() = {reply_.bytes.data(), reply_.bytes.size()};
    armed_at_ = 0;
    body_since_ = Clock::now();
    Arm(pool_->options.stall_s, "stalls in the middle of a transfer");
    ReadBody();
  }

  void Redirected(std::string_view target) {
    if (job_.redirections == kMostRedirections)
      return Fail(fmt::format("redirects more than {} times", kMostRedirections), true);
    auto to = RedirectedTo(location_, target);
    if (to && to->tls) {
      if (const Status ready = pool_->PrepareTls(); !ready) to = tl::unexpected<Error>(ready.error());
    }
    if (!to) return Fail(to.error().message, true);
    const auto pool = pool_;
    Job job = std::move(job_);
    Close();
    pool->Remove(this);
    pool->Redirect(std::move(job), std::move(*to));
  }

  /// Reads the beginning of a refusal's body, where the server's code is, and fails.
  void ReadRefusal(unsigned status) {
    // An address that the file's own address sent to may be signed, and expire.
    const bool refused = status == 400 || status == 401 || status == 403 || status == 404 || status == 410;
    if (refused && Elsewhere() && !job_.anew) {
      const auto pool = pool_;
      Job job = std::move(job_);
      Close();
      pool->Remove(this);
      return pool->Anew(std::move(job));
    }
    if (status == 200) return Fail(StatusSentence(status, ""), true);
    reply_ = {Bytes(kRefusalBytes), 0};
    parser_->get().body() = {reply_.bytes.data(), reply_.bytes.size()};
    refusal_ = status;
    Arm(std::min(pool_->options.stall_s, kRefusalS), "");
    ReadMoreOfRefusal();
  }

  void ReadMoreOfRefusal() {
    if (parser_->is_done() || parser_->get().body().empty()) return FailRefused();
    WithStream([this](auto& stream) {
      http::async_read_some(stream, buffer_, *parser_,
                            [self = shared_from_this()](const ErrorCode& error, size_t) {
                              if (self->closed_) return;
                              if (error) return self->FailRefused();
                              self->ReadMoreOfRefusal();
                            });
    });
  }

  void FailRefused() {
    const size_t have = reply_.bytes.size() - parser_->get().body().size();
    std::string body(AsText(std::span(reply_.bytes).first(have)));
    // Bytes beyond the reply stay in the buffer.
    const auto rest = buffer_.cdata();
    body.append(static_cast<const char*>(rest.data()), std::min(rest.size(), kRefusalBytes));
    const unsigned status = std::exchange(refusal_, 0);
    Fail(StatusSentence(status, CodeOf(body)), IsPermanentStatus(status));
  }

  void ReadBody() {
    if (parser_->is_done()) return Finish();
    WithStream([this](auto& stream) {
      http::async_read_some(
          stream, buffer_, *parser_, [self = shared_from_this()](const ErrorCode& error, size_t) {
            if (self->closed_) return;
            if (error) return self->FailRead(error);
            const uint64_t have = self->reply_.bytes.size() - self->parser_->get().body().size();
            if (self->TooSlow(have)) return self->Fail(self->SlowSentence());
            if (have - self->armed_at_ >= kStallBytes) {
              self->armed_at_ = have;
              self->Arm(self->pool_->options.stall_s, "stalls in the middle of a transfer");
            }
            self->ReadBody();
          });
    });
  }

  /// Whether `have` bytes of a body are fewer than should have come by now.
  bool TooSlow(uint64_t have) const {
    const double s = std::chrono::duration<double>(Clock::now() - body_since_).count();
    return have < reply_.bytes.size() &&
           static_cast<double>(have) < pool_->options.least_rate * (s - pool_->options.stall_s);
  }
  std::string SlowSentence() const {
    return fmt::format("is too slow: less than {:.0f} KiB a second", pool_->options.least_rate / 1024);
  }

  void Finish() {
    // body() is the part of the reply that is still empty.
    if (!parser_->get().body().empty()) return Fail("breaks off in the middle of a transfer");
    Disarm();
    const bool keep = parser_->keep_alive() && buffer_.size() == 0;
    const auto pool = pool_;
    Done done = std::move(job_.done);
    Reply reply = std::move(reply_);
    parser_.reset();
    used_ = true;
    if (keep) {
      pool->Idle(shared_from_this());
    } else {
      Close();
      pool->Remove(this);
    }
    done(std::move(reply));
    if (!pool->stopped) pool->Pump();
  }

  void FailRead(const ErrorCode& error) {
    const bool begun = parser_->got_some() || buffer_.size() > 0;
    const bool gone = error == http::error::end_of_stream || error == asio::error::eof ||
                      error == asio::error::connection_reset || error == asio::error::broken_pipe ||
                      error == asio::ssl::error::stream_truncated;
    if (used_ && !begun && gone && !job_.again) {
      const auto pool = pool_;
      Job job = std::move(job_);
      Close();
      pool->Remove(this);
      return pool->Again(std::move(job));
    }
    if (gone && !begun) return Fail("closes the connection without an answer");
    if (gone || error == http::error::partial_message) return Fail("breaks off in the middle of a transfer");
    if (error == http::error::body_limit || error == http::error::buffer_overflow)
      return Fail("sends more than requested");
    if (error == http::error::header_limit) return Fail("sends headers of more than 8 KiB");
    if (error.category() == http::make_error_code(http::error::bad_version).category())
      return Fail(fmt::format("does not speak HTTP ({})", error.message()));
    Fail(error.message());
  }

  void Fail(const std::string& sentence, bool permanent = false) {
    const auto self = shared_from_this();
    const auto pool = pool_;
    const Done done = std::move(job_.done);
    std::string sent;
    if (Elsewhere()) {
      sent = fmt::format("redirects to {}, which ", location_.text());
      pool->where = pool->location;  // asked again, it may send to another place
    }
    Close();
    pool->Remove(this);
    if (done)
      done(tl::unexpected<Error>(Error{fmt::format("{}: {}{}", pool->name, sent, sentence),
                                       permanent ? ErrorKind::kPermanent : ErrorKind::kFailed}));
    if (!pool->stopped) pool->Pump();
  }

  std::shared_ptr<Pool> pool_;
  tcp::resolver resolver_;
  asio::steady_timer timer_;
  uint64_t generation_ = 0;  // of the timer
  std::optional<tcp::socket> plain_;
  std::optional<asio::ssl::stream<tcp::socket>> tls_;
  boost::beast::flat_buffer buffer_;
  http::request<http::empty_body> request_;
  std::optional<http::response_parser<http::span_body<std::byte>>> parser_;
  Job job_;
  Reply reply_;
  HttpLocation location_;           // the address of the request
  std::optional<HttpProxy> proxy_;  // through which the connection goes
  std::optional<http::response_parser<http::empty_body>> tunnel_;
  Clock::time_point body_since_;
  uint64_t armed_at_ = 0;  // bytes received when the timer was last set
  unsigned refusal_ = 0;   // status whose body is being read
  bool connected_ = false, used_ = false, closed_ = false;
};

void HttpRangeClient::Pool::Pump() {
  while (!queue.empty()) {
    const bool fresh = queue.front().again;
    while (!idle.empty() &&
           (fresh || !idle.back()->Leads(where) || Clock::now() - idle.back()->idle_since > kKeepIdle)) {
      const auto old = std::exchange(idle.back(), nullptr);
      idle.pop_back();
      old->Close();
      Remove(old.get());
    }
    std::shared_ptr<Lane> lane;
    if (!idle.empty()) {
      lane = std::move(idle.back());
      idle.pop_back();
    } else if (lanes.size() < std::max(1u, options.connections)) {
      lane = NewLane();
    } else {
      return;
    }
    Job job = std::move(queue.front());
    queue.pop_front();
    lane->Start(std::move(job));
  }
}

std::shared_ptr<HttpRangeClient::Lane> HttpRangeClient::Pool::NewLane() {
  lanes.push_back(std::make_shared<Lane>(shared_from_this()));
  return lanes.back();
}

void HttpRangeClient::Pool::Idle(std::shared_ptr<Lane> lane) {
  lane->idle_since = Clock::now();
  idle.push_back(std::move(lane));
}

void HttpRangeClient::Pool::Remove(const Lane* lane) {
  std::erase_if(lanes, [&](const auto& l) { return l.get() == lane; });
}

void HttpRangeClient::Pool::Again(Job job) {
  ++counters.stale;
  job.again = true;
  queue.push_front(std::move(job));
  Pump();
}

void HttpRangeClient::Pool::Redirect(Job job, HttpLocation to) {
  where = std::move(to);
  ++job.redirections;
  queue.push_front(std::move(job));
  Pump();
}

void HttpRangeClient::Pool::Anew(Job job) {
  where = location;
  job.anew = true;
  job.redirections = 0;
  queue.push_front(std::move(job));
  Pump();
}

void HttpRangeClient::Pool::Stop() {
  stopped = true;
  queue.clear();
  idle.clear();
  for (const auto& lane : std::exchange(lanes, {})) lane->Close();
}

HttpRangeClient::HttpRangeClient(asio::io_context& io, HttpLocation location, HttpOptions options)
    : pool_(std::make_shared<Pool>(io, std::move(location), std::move(options))) {}

HttpRangeClient::~HttpRangeClient() { pool_->Stop(); }

const HttpLocation& HttpRangeClient::location() const { return pool_->location; }

HttpRangeClient::Counters HttpRangeClient::counters() const { return pool_->counters; }

void HttpRangeClient::Get(uint64_t offset, uint32_t size, Done done) {
  if (!pool_->setup) {
    return asio::post(pool_->io, [pool = pool_, done = std::move(done)] {
      if (!pool->stopped) done(tl::unexpected<Error>(pool->setup.error()));
    });
  }
  pool_->queue.push_back({offset, size, std::move(done)});
  pool_->Pump();
}

}  // namespace quarry
