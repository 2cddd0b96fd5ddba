#include "master/display/page.h"

#include <fmt/format.h>

#include <utility>

#include "common/base/resource.h"
#include "master/display/page_files.h"

namespace quarry {
namespace {

constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src "
    "'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'";

std::string HostOf(const Endpoint& endpoint) {
  return endpoint.host.find(':') == std::string::npos ? endpoint.host : "[" + endpoint.host + "]";
}

HttpResponse Page(const std::string& name, int status = 200) {
  const PageFile* file = FindPageFile(name);
  if (!file) return Refused(404, "there is no such page");
  return {.status = status,
          .content_type = fmt::format("{}; charset=utf-8", file->content_type),
          .body = std::string(file->content),
          .headers = {{"Content-Security-Policy", kPolicy}, {"Referrer-Policy", "no-referrer"}}};
}

}  // namespace

Result<Access> MakeAccess(const DisplayOptions& options) {
  AccessOptions access{.token = options.token,
                       .hosts = {HostOf(options.listen), HostName()},
                       .tls = !options.tls.cert.empty()};
  for (const std::string& text : options.viewer_urls) {
    QUARRY_ASSIGN(ViewerUrl url, ParseViewerUrl(text));
    access.viewer_urls.push_back(std::move(url));
  }
  return Access::Make(std::move(access));
}

std::string AddressOf(const DisplayOptions& options, const Access& access, uint16_t port) {
  const bool anywhere = options.listen.host == "0.0.0.0" || options.listen.host == "::";
  std::string base = fmt::format("{}://{}:{}/", options.tls.cert.empty() ? "http" : "https",
                                 anywhere ? HostName() : HostOf(options.listen), port);
  if (!options.viewer_urls.empty())
    if (const auto url = ParseViewerUrl(options.viewer_urls.front())) base = url->text();
  return fmt::format("{}?token={}", base, access.token());
}

std::string NameOfPage(const std::string& path) { return path.substr(path.rfind('/') + 1); }

HttpResponse Refused(int status, const std::string& sentence) {
  return {.status = status, .body = sentence + "\n"};
}

std::optional<HttpResponse> AnswerForAll(const HttpRequest& request, const Access& access) {
  if (NameOfPage(request.path) == "healthz") return HttpResponse{.body = "ok\n"};
  if (access.HostPermitted(request)) return std::nullopt;
  // A browser gets a page, with its style sheet.
  const std::string name = NameOfPage(request.path);
  if (name == "style.css" || name == "icon.svg") return Page(name);
  if (name.empty() || name.ends_with(".html")) return Page("foreign.html", 403);
  return Refused(403, "this address is not allowed; add it with --viewer-url");
}

HttpResponse PageFor(const HttpRequest& request, const Access& access, const std::string& start) {
  const std::string name = NameOfPage(request.path);
  if (!name.empty() && !name.ends_with(".html")) return Page(name);
  if (access.HasToken(request)) {
    HttpResponse page = Page(start);
    page.headers.emplace_back("Set-Cookie", access.SetCookie(request));
    return page;
  }
  return access.HasSession(request) ? Page(start) : Page("denied.html", 403);
}

}  // namespace quarry
