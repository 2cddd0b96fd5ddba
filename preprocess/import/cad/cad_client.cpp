#include "preprocess/import/cad/cad_client.h"

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "common/base/descriptor.h"
#include "preprocess/import/foreign/child_environment.h"

namespace quarry {
namespace {

constexpr size_t kBufferBytes = 1 << 18;
constexpr const char* kOtherFormats =
    "export triangles, as glTF, OBJ or STL, from a CAD program (FreeCAD, say)";

}  // namespace

Status CadClient::Ask(CadFormat format, const std::string& path) {
  QUARRY_TRY(helper_.Start());
  ByteWriter request;
  request.Put(static_cast<uint32_t>(format));
  request.Put(static_cast<uint32_t>(path.size()));
  request.Put(reading_.linear);
  request.Put(reading_.angle);
  request.PutArray(path);
  if (!WriteAll(helper_.to(), request.bytes())) return Ended("");
  return {};
}

/// Reads until `out` is full, ahead where the pipe holds more. False: the process has closed it.
bool CadClient::Read(std::span<std::byte> out) {
  while (!out.empty()) {
    if (at_ == buffer_.size()) {
      buffer_.resize(kBufferBytes);
      at_ = 0;
      const ssize_t n = ::read(helper_.from(), buffer_.data(), buffer_.size());
      buffer_.resize(static_cast<size_t>(std::max<ssize_t>(n, 0)));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return false;
    }
    const size_t count = std::min(out.size(), buffer_.size() - at_);
    std::memcpy(out.data(), buffer_.data() + at_, count);
    at_ += count;
    out = out.subspan(count);
  }
  return true;
}

tl::unexpected<Error> CadClient::Lies() {
  return Fail(fmt::format("the process that reads it gives an invalid answer: the model may be damaged; {}",
                          kOtherFormats));
}

Result<CadClient::Message> CadClient::Next(const std::string& part) {
  std::byte header[kCadHeaderBytes];
  if (!Read(header)) return Ended(part);
  ByteReader in(header);
  const auto kind = static_cast<CadMessage>(in.Get<uint32_t>());
  const auto size = in.Get<uint32_t>();
  if (size > kMostCadMessage) return Lies();
  content_.resize(size);
  if (!Read(content_)) return Ended(part);
  if (kind == CadMessage::kTooLarge)
    return Fail(fmt::format("needs more memory than --memory allows Open CASCADE, {} MiB; give more, or {}",
                            reading_.memory >> 20, kOtherFormats));
  if (kind == CadMessage::kRefused)
    return Fail(fmt::format("{}; {}", AsText(content_).substr(0, 1000), kOtherFormats));
  return Message{kind, content_};
}

/// The helper has ended before its last message; the result is the reason.
tl::unexpected<Error> CadClient::Ended(const std::string& part) {
  const int status = helper_.Wait();
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNoLibrary)
    return Fail(fmt::format(
        "{} lacks shared libraries: install Open CASCADE (Debian's package libocct-data-exchange-7.6), or {}",
        helper_.program(), kOtherFormats));
  if (WIFEXITED(status))
    return Fail(fmt::format("the process that reads it, {}, has ended before its answer (status {}); {}",
                            helper_.program(), WEXITSTATUS(status), kOtherFormats));
  const std::string where = part.empty() ? "" : fmt::format(" (in \"{}\")", part);
  const int signal = WTERMSIG(status);
  if (signal == SIGXCPU)
    return Fail(fmt::format("Open CASCADE makes no progress with it in ten minutes of processor time{}; {}",
                            where, kOtherFormats));
  // The kernel kills so when memory is short, and so do people: the model is not at fault.
  if (signal == SIGKILL || signal == SIGTERM || signal == SIGINT || signal == SIGHUP)
    return Fail(fmt::format("the process that reads it was ended by signal {}", signal));
  return Fail(fmt::format("Open CASCADE has crashed on it{}: it may be damaged; {}", where, kOtherFormats));
}

}  // namespace quarry
