#include "master/display/preparing.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "common/base/log.h"
#include "master/display/page.h"

namespace quarry {
namespace {

/// A file of the preprocessor, up to `most` bytes; empty: there is none.
std::string ReadFile(const std::string& path, size_t most) {
  std::error_code none;
  const auto size = std::filesystem::file_size(path, none);
  std::string text(none ? 0 : std::min<uintmax_t>(size, most), '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  return text;
}

/// Tells one state of a file that is replaced from another.
std::string StateOf(const std::string& path) {
  std::error_code none;
  return fmt::format("{}", std::filesystem::last_write_time(path, none).time_since_epoch().count());
}

/// The preprocessor's last line.
std::string ReadProgress(const std::string& path) {
  constexpr size_t kMost = 1 << 16;
  const std::string text = ReadFile(path, kMost);
  return text.empty() ? R"({"step": "starting", "done": 0, "eta_s": null})" : text;
}

}  // namespace

Status ServePreparing(const DisplayOptions& options, const std::string& progress_file) {
  boost::asio::io_context io;
  QUARRY_ASSIGN(const Access access, MakeAccess(options));
  const auto answer = [&](const HttpRequest& request) -> HttpResponse {
    const std::string name = NameOfPage(request.path);
    if (const auto common = AnswerForAll(request, access)) return *common;
    if (name != "progress" && name != "discs") return PageFor(request, access, "preparing.html");
    if (!access.HasSession(request)) return Refused(403, "the session's cookie is missing");
    if (name == "discs") {
      constexpr size_t kMost = 16 << 20;  // 256 K discs take 6 MiB
      const std::string path = progress_file + ".discs", state = StateOf(path);
      if (request.query == "seen=" + state) return {.status = 204};
      std::string discs = ReadFile(path, kMost);
      if (discs.empty()) return Refused(404, "no triangle has been read yet");
      return {
          .content_type = "application/octet-stream", .body = std::move(discs), .headers = {{"ETag", state}}};
    }
    return {.content_type = "application/json", .body = ReadProgress(progress_file)};
  };
  QUARRY_ASSIGN(const auto server,
                HttpServer::Open(io, {.listen = options.listen, .tls = options.tls}, {answer, {}, {}}));
  Print(fmt::format("viewing {}\n", AddressOf(options, access, server->port())));
  FlushOutput();
  io.run();
  return {};
}

}  // namespace quarry
