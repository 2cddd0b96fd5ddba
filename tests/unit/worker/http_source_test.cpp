#include "worker/sources/http_source.h"

#include <fmt/format.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <memory>
#include <mutex>
#include <utility>

#include "common/voxel/store_header.h"
#include "tests/support/servers/fault_server.h"
#include "tests/support/servers/http_fetches.h"

namespace quarry {
namespace {

using Catch::Matchers::Contains;
using test::CheckAllBlocks;
using test::FaultServer;
using test::FetchAll;
using test::FetchOne;
using test::Location;
using test::Patient;
using Scene = test::ServedScene;
using Then = FaultServer::Then;

/// The error of fetching block 0 from a server that answers requests for blocks with `fault`, and requests of
/// the check rightly.
Error FaultOfBlock(
    const std::function<FaultServer::Answer(const FaultServer::Request&, const std::string&)>& fault,
    double seconds = 60) {
  const Scene scene;
  const uint64_t first_block = scene.catalog().block(0_b).offset;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    if (r.first >= first_block) return fault(r, scene.bytes);
    return {FaultServer::Part(r, scene.bytes)};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient(seconds));
  const auto got = FetchOne(io, source, 0_b);
  REQUIRE(!got.has_value());
  CHECK_THAT(got.error().message, Contains(server.url()));
  CHECK(got.error().message.find('\n') == std::string::npos);
  return got.error();
}

/// The last answer to `times` requests, one after the other, for a file of `size` bytes.
Result<HttpRangeClient::Reply> GetAll(const FaultServer& server, uint64_t size, const HttpOptions& options,
                                      int times = 1) {
  boost::asio::io_context io;
  HttpRangeClient client(io, Location(server.url()), options);
  Result<HttpRangeClient::Reply> last = Fail("not asked");
  for (int i = 0; i < times; ++i) {
    client.Get(0, static_cast<uint32_t>(size), [&](auto reply) { last = std::move(reply); });
    io.restart();
    io.run();
  }
  return last;
}

Error FaultOfBlock(const std::string& answer, Then then = Then::kKeep, double seconds = 60) {
  return FaultOfBlock([&](const auto&, const auto&) { return FaultServer::Answer{answer, then}; }, seconds);
}

}  // namespace

TEST_CASE("Requests carry headers and signatures, at the time that is given") {
  const Scene scene;
  std::mutex mutex;
  std::vector<std::string> heads;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    const std::lock_guard lock(mutex);
    heads.push_back(r.head);
    return {FaultServer::Part(r, scene.bytes)};
  });
  HttpOptions options = Patient();
  options.headers = {{"X-Team", "a b"}, {"x-amz-request-payer", "requester"}};
  options.aws = AwsCredentials{"eu", "KEY", "SECRET", "TOKEN"};
  options.now = [] { return std::time_t{1369353600}; };
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), options);
  REQUIRE(FetchOne(io, source, 0_b).has_value());
  const std::lock_guard lock(mutex);
  REQUIRE(heads.size() == 3);
  const BlockEntry& block = scene.catalog().block(0_b);
  const std::string& head = heads[2];
  const std::string range = fmt::format("bytes={}-{}", block.offset, block.offset + block.stored - 1);
  CHECK_THAT(head, Contains("GET /store HTTP/1.1\r\n") && Contains("Range: " + range + "\r\n"));
  CHECK_THAT(head, Contains("X-Team: a b\r\n") && Contains("x-amz-date: 20130524T000000Z\r\n"));
  CHECK_THAT(head, Contains("x-amz-security-token: TOKEN\r\n"));
  const auto added = SignAwsRequest({fmt::format("127.0.0.1:{}", server.port()),
                                     "/store",
                                     {{"range", range}, {"x-amz-request-payer", "requester"}}},
                                    *options.aws, 1369353600);
  CHECK_THAT(head, Contains("Authorization: " + added.back().value + "\r\n"));
}

TEST_CASE("Connections are few, kept and used again") {
  const Scene scene(20);
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    return {FaultServer::Part(r, scene.bytes)};
  });
  HttpOptions options = Patient();
  options.connections = 3;
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), options);
  CheckAllBlocks(io, source, *scene.store);
  CheckAllBlocks(io, source, *scene.store);
  const auto counters = source.counters();
  const auto blocks = test::BlocksOf(scene.catalog());
  CHECK(counters.http.connections <= 3);
  CHECK(counters.http.requests == 2 * blocks.size() + 2);  // and header and table, once
  uint64_t stored = 0;
  for (const BlockKey b : blocks) stored += scene.catalog().block(b).stored;
  CHECK(counters.bytes_received == 2 * stored);
}

TEST_CASE("A kept connection that the server closed is silently made again") {
  const Scene scene(20);
  // It promises to keep them, and closes each after three answers.
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    return {FaultServer::Part(r, scene.bytes), r.on_connection == 2 ? Then::kClose : Then::kKeep};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient());
  for (const BlockKey block : test::BlocksOf(scene.catalog())) {
    const auto got = FetchOne(io, source, block);
    INFO("block " << scene.catalog().NumberOf(block) << (got ? "" : ": " + got.error().message));
    REQUIRE(got.has_value());
    REQUIRE(*got == scene.store->ReadBlock(block).value());
  }
  CHECK(source.counters().http.stale > 0);
  CHECK(source.counters().http.connections > 2);
}

TEST_CASE("A server that closes every connection without an answer gets two tries, no more") {
  const Scene scene;
  std::atomic<int> requests = 0;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    ++requests;
    if (r.number < 2) return {FaultServer::Part(r, scene.bytes)};
    return {"", Then::kClose};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient());
  const auto got = FetchOne(io, source, 0_b);
  REQUIRE(!got.has_value());
  CHECK(!got.error().permanent());
  CHECK_THAT(got.error().message, Contains("without an answer"));
  CHECK(requests == 4);
}

TEST_CASE("A connection that the server announces to close is not used again") {
  const Scene scene;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    std::string answer = FaultServer::Part(r, scene.bytes);
    answer.insert(answer.find("\r\n") + 2, "Connection: close\r\n");
    return {answer, Then::kClose};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient());
  CheckAllBlocks(io, source, *scene.store);
  CHECK(source.counters().http.stale == 0);
}

TEST_CASE("Statuses become sentences, and are permanent where a retry cannot help") {
  struct Case {
    std::string status, sentence;
    bool permanent;
  };
  for (const Case& c : std::vector<Case>{{"200 OK", "does not serve ranges", true},
                                         {"204 No Content", "204", true},
                                         {"302 Found", "302 Found: it does not say where", true},
                                         {"401 Unauthorized", "401 Unauthorized", true},
                                         {"403 Forbidden", "403 Forbidden", true},
                                         {"404 Not Found", "404 Not Found", true},
                                         {"408 Request Timeout", "408", false},
                                         {"416 Range Not Satisfiable", "416 Range Not Satisfiable", true},
                                         {"429 Too Many Requests", "429 Too Many Requests", false},
                                         {"500 Internal Server Error", "500 Internal Server Error", false},
                                         {"503 <script>", "503 Service Unavailable", false},
                                         {"599 What", "599", false}}) {
    INFO(c.status);
    const Error error = FaultOfBlock("HTTP/1.1 " + c.status + "\r\nContent-Length: 4\r\n\r\nbody");
    CHECK_THAT(error.message, Contains(c.sentence));
    CHECK(error.permanent() == c.permanent);
  }
}

TEST_CASE("A refusal names the server's code, and nothing else of its text") {
  const auto refusal = [](const std::string& head, const std::string& body) {
    return FaultOfBlock(fmt::format("HTTP/1.1 {}\r\nContent-Length: {}\r\n\r\n{}", head, body.size(), body))
        .message;
  };
  const std::string xml =
      "<?xml version=\"1.0\"?>\n<Error><Code>ExpiredToken</Code><Message>secret</Message></Error>";
  const std::string expired = refusal("403 Forbidden", xml);
  CHECK_THAT(expired, Contains("answers 403 Forbidden (ExpiredToken): the credentials have expired"));
  CHECK(expired.find("secret") == std::string::npos);
  CHECK_THAT(refusal("400 Bad Request", xml + std::string(50000, ' ')),
             Contains("400 Bad Request (ExpiredToken)"));
  CHECK_THAT(refusal("404 Not Found", "<Error><Code>NoSuchBucket</Code></Error>"),
             Contains("(NoSuchBucket)"));
  CHECK_THAT(refusal("403 Forbidden", "{\"error\": {\"code\": \"Denied\"}}"),
             Contains("403 Forbidden (Denied)"));
  for (const char* odd :
       {"<Code>a b</Code>", "<Code>\x1b[31m</Code>", "<Code></Code>", "<Code>x", "\"code\":", "<Code>"})
    CHECK_THAT(refusal("403 Forbidden", odd), Contains("answers 403 Forbidden: "));
  // A body that never comes does not hold the sentence back.
  CHECK_THAT(FaultOfBlock("HTTP/1.1 403 Forbidden\r\nContent-Length: 100\r\n\r\n<Code>Slow</Code>",
                          Then::kStall, 0.3)
                 .message,
             Contains("403 Forbidden (Slow)"));
}

TEST_CASE("A body that arrives too slowly is given up") {
  const std::string file(512 << 10, 'x');
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    return {FaultServer::Part(r, file), Then::kTrickle};
  });
  HttpOptions options = Patient(0.25);  // pieces of 8 KiB in 50 ms never stall
  options.least_rate = 1 << 20;
  CHECK_THAT(GetAll(server, file.size(), options).error().message,
             Contains("too slow: less than 1024 KiB a second"));
}

TEST_CASE("Redirections are followed, and other servers get no secrets") {
  const std::string file = "the file's bytes";
  std::vector<std::string> heads;
  FaultServer other([&](const FaultServer::Request& r) -> FaultServer::Answer {
    heads.push_back(r.head);
    return {FaultServer::Part(r, file)};
  });
  std::vector<std::string> first_heads;
  const auto sends_to = [](const std::string& place) {
    return FaultServer::Answer{
        fmt::format("HTTP/1.1 302 Found\r\nLocation: {}\r\nContent-Length: 0\r\n\r\n", place)};
  };
  FaultServer first([&](const FaultServer::Request& r) {
    first_heads.push_back(r.head);
    return r.head.starts_with("GET /store ") ? sends_to("/moved?x=1") : sends_to(other.url() + "?sig=secret");
  });
  HttpOptions options = Patient();
  options.headers = {{"Authorization", "Bearer secret"}};
  const auto got = GetAll(first, file.size(), options, 2);
  REQUIRE(got.has_value());
  CHECK(AsText(got->bytes) == file);
  REQUIRE(first_heads.size() == 2);  // the second request goes to the last address at once
  CHECK_THAT(first_heads[0], Contains("Bearer secret"));
  CHECK_THAT(first_heads[1], Contains("GET /moved?x=1 ") && Contains("Bearer secret"));
  REQUIRE(heads.size() == 2);
  for (const std::string& head : heads) {
    CHECK_THAT(head, Contains("GET /store?sig=secret ") &&
                         Contains(fmt::format("Host: 127.0.0.1:{}", other.port())));
    CHECK(head.find("Bearer") == std::string::npos);
  }
}

TEST_CASE("Redirections end after five, and a refused address is redirected anew") {
  const std::string file = "the file's bytes";
  int asked = 0;
  FaultServer circle([&](const FaultServer::Request&) -> FaultServer::Answer {
    ++asked;
    return {"HTTP/1.1 307 Temporary Redirect\r\nLocation: /store\r\nContent-Length: 0\r\n\r\n"};
  });
  const auto circling = GetAll(circle, file.size(), Patient());
  REQUIRE_FALSE(circling.has_value());
  CHECK_THAT(circling.error().message, Contains("redirects more than 5 times"));
  CHECK(circling.error().permanent());
  CHECK(asked == 6);

  // An address with a signature that serves one request, then is refused.
  int signature = 0, served = 0;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    if (r.head.starts_with("GET /store "))
      return {fmt::format("HTTP/1.1 302 Found\r\nLocation: /real?sig={}\r\nContent-Length: 0\r\n\r\n",
                          ++signature)};
    const bool fresh =
        r.head.find(fmt::format("sig={} ", signature)) != std::string::npos && served < signature;
    if (!fresh) return {"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n"};
    ++served;
    return {FaultServer::Part(r, file)};
  });
  CHECK(GetAll(server, file.size(), Patient(), 3).has_value());
  CHECK(signature == 3);

  FaultServer refusing([&](const FaultServer::Request& r) -> FaultServer::Answer {
    if (r.head.starts_with("GET /store "))
      return {"HTTP/1.1 302 Found\r\nLocation: /real?sig=secret\r\nContent-Length: 0\r\n\r\n"};
    return {"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n"};
  });
  const auto refused = GetAll(refusing, file.size(), Patient());
  REQUIRE_FALSE(refused.has_value());
  CHECK_THAT(refused.error().message,
             Contains("/store: redirects to http://127.0.0.1") && Contains("/real?…, which answers 403"));
  CHECK(refused.error().message.find("secret") == std::string::npos);
}

TEST_CASE("After a 503 the next request is answered") {
  const Scene scene;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    if (r.number % 3 == 0) return {"HTTP/1.1 503 Busy\r\nContent-Length: 0\r\n\r\n"};
    return {FaultServer::Part(r, scene.bytes)};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient());
  int failed = 0;
  for (int i = 0; i < 10; ++i) {
    const auto got = FetchOne(io, source, 2_b);
    if (!got) {
      ++failed;
      CHECK(!got.error().permanent());
      continue;
    }
    CHECK(*got == scene.store->ReadBlock(2_b).value());
  }
  CHECK(failed > 0);
  CHECK(failed < 10);
}

TEST_CASE("Answers with another range than the one asked for are refused") {
  const auto answer = [](const std::string& range) {
    return FaultOfBlock([range](const FaultServer::Request& r, const std::string& file) {
      const uint64_t size = r.last - r.first + 1;
      return FaultServer::Answer{
          fmt::format(
              "HTTP/1.1 206 Partial Content\r\nContent-Length: {}\r\n{}\r\n", size,
              fmt::format(fmt::runtime(range), r.first, r.last, r.first + 1, r.last + 1, file.size())) +
              file.substr(r.first, size),
          Then::kKeep};
    });
  };
  for (const char* range :
       {"", "Content-Range: bytes {2}-{3}/{4}\r\n", "Content-Range: bytes {0}-{3}/{4}\r\n",
        "Content-Range: bytes {0}-{1}/{1}\r\n", "Content-Range: bytes {0}-{1}\r\n",
        "Content-Range: bytes {0}-{1}/{4}x\r\n", "Content-Range: items {0}-{1}/{4}\r\n",
        "Content-Range: bytes 99999999999999999999-{1}/{4}\r\n", "Content-Range: bytes */{4}\r\n"}) {
    INFO(range);
    CHECK_THAT(answer(range).message, Contains("another range"));
  }
  const Error encoded = answer("Content-Range: bytes {0}-{1}/{4}\r\nContent-Encoding: gzip\r\n");
  CHECK_THAT(encoded.message, Contains("encoded"));
  CHECK(encoded.permanent());
  const Error grown = answer("Content-Range: bytes {0}-{1}/9999999\r\n");
  CHECK_THAT(grown.message, Contains("has changed: it is"));
  CHECK(grown.permanent());
}

TEST_CASE("Bodies that are cut, too long, stalled or garbage are errors, not blocks") {
  const auto part = [](const FaultServer::Request& r, const std::string& file) {
    return FaultServer::Part(r, file);
  };
  const Error cut = FaultOfBlock([&](const auto& r, const auto& file) {
    const std::string whole = part(r, file);
    return FaultServer::Answer{whole.substr(0, whole.size() - 10), Then::kClose};
  });
  CHECK_THAT(cut.message, Contains("breaks off"));
  CHECK(!cut.permanent());

  const Error stalled = FaultOfBlock(
      [&](const auto& r, const auto& file) {
        const std::string whole = part(r, file);
        return FaultServer::Answer{whole.substr(0, whole.size() - 10), Then::kStall};
      },
      0.3);
  CHECK_THAT(stalled.message, Contains("stalls"));
  CHECK(!stalled.permanent());

  const auto chunked = [&](const std::string& chunks, Then then) {
    return FaultOfBlock([&](const FaultServer::Request& r, const std::string& file) {
      return FaultServer::Answer{fmt::format("HTTP/1.1 206 Partial Content\r\nTransfer-Encoding: chunked\r\n"
                                             "Content-Range: bytes {}-{}/{}\r\n\r\n{}",
                                             r.first, r.last, file.size(), chunks),
                                 then};
    });
  };
  CHECK_THAT(chunked("10\r\n0123456789abcdef\r\n0\r\n\r\n", Then::kKeep).message, Contains("breaks off"));
  CHECK_THAT(chunked("zzz\r\n", Then::kKeep).message, Contains("not speak HTTP"));
  std::string large = "20000\r\n" + std::string(0x20000, 'x') + "\r\n0\r\n\r\n";
  CHECK_THAT(chunked(large, Then::kKeep).message, Contains("more than requested"));

  const Error longer = FaultOfBlock([&](const FaultServer::Request& r, const std::string& file) {
    std::string whole = part(r, file);
    const std::string length = fmt::format("Content-Length: {}", r.last - r.first + 1);
    whole.replace(whole.find(length), length.size(), "Content-Length: 99999999999");
    return FaultServer::Answer{whole, Then::kKeep};
  });
  CHECK(!longer.permanent());

  CHECK_THAT(FaultOfBlock("\x16\x03\x01 garbage\r\n\r\n").message, Contains("not speak HTTP"));
  CHECK_THAT(FaultOfBlock("SSH-2.0-OpenSSH\r\n", Then::kStall, 0.3).message, Contains("not speak HTTP"));
  CHECK_THAT(FaultOfBlock("HTTP/1.1 206 Part", Then::kStall, 0.3).message, Contains("does not answer"));
  CHECK_THAT(FaultOfBlock("", Then::kStall, 0.3).message, Contains("does not answer"));
  CHECK_THAT(FaultOfBlock("HTTP/1.1 206 Part", Then::kClose).message, Contains("breaks off"));
  const std::string huge = "HTTP/1.1 206 Partial Content\r\nX: " + std::string(100'000, 'x') + "\r\n\r\n";
  CHECK_THAT(FaultOfBlock(huge).message, Contains("headers of more than 8 KiB"));
}

TEST_CASE("Bytes sent after an answer are not taken for the next answer") {
  const Scene scene;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    return {FaultServer::Part(r, scene.bytes) + "HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n"};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient());
  for (const BlockKey block : test::BlocksOf(scene.catalog())) {
    const auto got = FetchOne(io, source, block);
    // Where the surplus comes in a segment of its own it may meet the next request: an error then, never a
    // wrong block.
    if (got) CHECK(*got == scene.store->ReadBlock(block).value());
  }
}

TEST_CASE("An unreachable server is a temporary error") {
  const Scene scene;
  uint16_t port;
  {
    const FaultServer server([](const auto&) { return FaultServer::Answer{}; });
    port = server.port();
  }
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(fmt::format("http://127.0.0.1:{}/s", port)), scene.catalog(),
                         Patient());
  for (const auto& got : FetchAll(io, source, {0_b, 2_b, 4_b})) {
    REQUIRE(!got.has_value());
    CHECK_THAT(got.error().message, Contains("cannot be reached"));
    CHECK(!got.error().permanent());
  }
}

TEST_CASE("A file that is not the scene's store is refused before a block is requested") {
  const Scene scene, other(8, 2), longer(9);
  std::mutex mutex;
  std::string served;
  const auto serve = [&](std::string file) {
    const std::lock_guard lock(mutex);
    served = std::move(file);
  };
  std::atomic<int> requests = 0;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    ++requests;
    const std::lock_guard lock(mutex);
    return {FaultServer::Part(r, served)};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), scene.catalog(), Patient());
  const auto refusal = [&](std::string file) {
    serve(std::move(file));
    requests = 0;
    const auto got = FetchOne(io, source, 0_b);
    REQUIRE(!got.has_value());
    CHECK(got.error().permanent());
    CHECK(requests <= 2);
    CHECK_THAT(got.error().message, Contains(server.url()));
    return got.error().message;
  };
  CHECK_THAT(refusal(other.bytes),
             Contains(FormatSceneId(other.catalog().id)) && Contains(FormatSceneId(scene.catalog().id)));
  CHECK_THAT(refusal(longer.bytes), Contains("another scene"));
  CHECK_THAT(refusal(std::string(5000, 'x')), Contains("not a Quarry scene store"));
  CHECK_THAT(refusal(scene.bytes + "x"), Contains("has 1 bytes behind the end of its store"));
  std::string damaged = scene.bytes;
  damaged[40] ^= 1;
  CHECK_THAT(refusal(damaged), Contains("header is damaged"));
  damaged = scene.bytes;
  damaged[kStoreHeaderBytes + 8] ^= 1;
  CHECK_THAT(refusal(damaged), Contains("section table is damaged"));
  // Once the right one is there, it is taken.
  serve(scene.bytes);
  CheckAllBlocks(io, source, *scene.store);
}

TEST_CASE("The same scene in another layout than the catalog's is refused") {
  const Scene scene;
  Catalog moved = scene.catalog();
  for (VoxelEntry& v : moved.voxels)
    for (BlockEntry& b : v.blocks) b.offset += 8;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    return {FaultServer::Part(r, scene.bytes)};
  });
  boost::asio::io_context io;
  HttpVoxelSource source(io, Location(server.url()), moved, Patient());
  const auto got = FetchOne(io, source, 0_b);
  REQUIRE(!got.has_value());
  CHECK(got.error().permanent());
  CHECK_THAT(got.error().message, Contains("compressed in another way"));
}

TEST_CASE("Blocks that the catalog lacks are errors, and a source that ends calls nobody") {
  const Scene scene;
  FaultServer server([&](const FaultServer::Request& r) -> FaultServer::Answer {
    return {FaultServer::Part(r, scene.bytes)};
  });
  boost::asio::io_context io;
  auto source = std::make_unique<HttpVoxelSource>(io, Location(server.url()), scene.catalog(), Patient());
  for (const BlockKey none : {3_b, 16_b, BlockKey::Page(0), BlockKey::Page(~0u)}) {
    const auto got = FetchOne(io, *source, none);
    REQUIRE(!got.has_value());
    CHECK(got.error().permanent());
  }
  REQUIRE(FetchOne(io, *source, 0_b).has_value());
  bool ended = false;
  for (uint32_t i = 0; i < 8; ++i) source->Fetch(BlockKey::Hot(i), [&](const auto&) { CHECK(!ended); });
  io.restart();
  io.poll();
  source.reset();
  ended = true;
  io.restart();
  io.run();

  // From within a callback, too.
  source = std::make_unique<HttpVoxelSource>(io, Location(server.url()), scene.catalog(), Patient());
  int called = 0;
  for (uint32_t i = 0; i < 8; ++i)
    source->Fetch(BlockKey::Hot(i), [&](const auto&) {
      ++called;
      source.reset();
    });
  io.restart();
  io.run();
  CHECK(called == 1);
}

}  // namespace quarry
