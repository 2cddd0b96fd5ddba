#include "master/display/preparing.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <cstdio>
#include <fstream>

#include "common/base/log.h"
#include "master/display/page.h"

namespace quarry {
namespace {

/// The preprocessor's last line.
std::string ReadProgress(const std::string& path) {
  constexpr size_t kMost = 1 << 16;
  std::string text(kMost, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(file.gcount()));
  return text.empty() ? R"({"step": "starting", "done": 0, "eta_s": null})" : text;
}

}  // namespace

Status ServePreparing(const DisplayOptions& options, const std::string& progress_file) {
  boost::asio::io_context io;
  QUARRY_ASSIGN(const Access access, MakeAccess(options));
  const auto answer = [&](const HttpRequest& request) -> HttpResponse {
    const std::string name = NameOfPage(request.path);
    if (const auto common = AnswerForAll(request, access)) return *common;
    if (name != "progress") return PageFor(request, access, "preparing.html");
    if (!access.HasSession(request)) return Refused(403, "the session's cookie is missing");
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
