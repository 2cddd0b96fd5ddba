#include "deploy/command/view_command.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>

#include "common/base/bytes.h"
#include "common/base/cleanup.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/number.h"
#include "common/command_line/command_line.h"
#include "common/net/connection.h"
#include "common/remote/open_store.h"
#include "deploy/command/cluster.h"
#include "deploy/command/model_cache.h"
#include "deploy/command/view_token.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

/// Ports that are tried without --http.
constexpr uint16_t kFirstPort = 8080, kPorts = 20;

/// A free port at a host's first address: `port` itself if it is free, for 0 any. Nothing: there is none, or
/// the host is unknown, which the master reports.
std::optional<uint16_t> FreePort(const std::string& host, uint16_t port) {
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) return std::nullopt;
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> address(found, ::freeaddrinfo);
  const int fd = ::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return std::nullopt;
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  socklen_t size = found->ai_addrlen;
  const bool free = ::bind(fd, found->ai_addr, size) == 0 && ::getsockname(fd, found->ai_addr, &size) == 0;
  ::close(fd);
  if (!free) return std::nullopt;
  // Both families have the port at the same place.
  return ntohs(reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_port);
}

/// The address of the page. Its port is chosen here, since two programs serve there one after the other: the
/// page that shows the preprocessing, and the live view.
Result<Endpoint> ChooseAddress(const ViewArguments& a) {
  Endpoint chosen{"127.0.0.1", 0};
  if (!a.http.empty()) {
    QUARRY_ASSIGN(chosen, ParseEndpoint(a.http, "--http"));
    if (chosen.port == 0) chosen.port = FreePort(chosen.host, 0).value_or(0);
    return chosen;
  }
  for (uint16_t port = kFirstPort; chosen.port == 0 && port < kFirstPort + kPorts; ++port)
    chosen.port = FreePort(chosen.host, port).value_or(0);
  if (chosen.port == 0) chosen.port = FreePort(chosen.host, 0).value_or(0);
  return chosen;
}

/// A folder of this run's own, for its token and its progress. Removed with this, or by a signal.
class PrivateFolder {
 public:
  static Result<std::unique_ptr<PrivateFolder>> Make() {
    std::error_code error;
    std::string path = (fs::temp_directory_path(error) / "quarry-view-XXXXXX").string();
    const SignalsHeld held;
    if (error || !::mkdtemp(path.data())) return Fail("cannot make a folder for temporary files");
    return std::unique_ptr<PrivateFolder>(new PrivateFolder(std::move(path)));
  }
  ~PrivateFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
    Forget(registered_);
  }
  std::string file(const char* name) const { return path_ + "/" + name; }

 private:
  explicit PrivateFolder(std::string path)
      : path_(std::move(path)), registered_(RemoveFolderOnSignal(path_)) {}
  const std::string path_;
  const int registered_;
};

/// The file with the view's token: the one kept for this store and port, else one of this run's own.
Result<std::string> TokenFile(const ViewArguments& a, const std::string& address,
                              const PrivateFolder& folder) {
  auto kept = KeptTokenFile(a.scene, address);
  if (kept) return kept;
  if (!a.quiet)
    Log("the token is new, and pages of an earlier view need the address below: " + kept.error().message);
  std::string own = folder.file("token");
  QUARRY_TRY(WriteNewToken(own));
  return own;
}

/// Opens a browser on a page of the folder that leads to the address: a command line, with the token, could
/// be read by everybody on this machine.
void OpenBrowser(const PrivateFolder& folder, const std::string& url) {
  const std::string page = folder.file("open.html");
  const int fd = ::open(page.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  const std::string text =
      fmt::format("<!doctype html><meta http-equiv=\"refresh\" content=\"0; url={}\">\n", url);
  const bool written = fd >= 0 && ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  if (fd >= 0) ::close(fd);
  if (!written) return;
  // Without a display xdg-open would start a browser inside of this terminal.
  const bool shown = std::getenv("DISPLAY") || std::getenv("WAYLAND_DISPLAY") || std::getenv("BROWSER");
  const pid_t child = shown ? ::fork() : -1;
  if (child == 0) {
    const int nowhere = ::open("/dev/null", O_RDWR);
    for (const int stream : {0, 1, 2}) ::dup2(nowhere, stream);  // it writes sentences of its own
    ::execlp("xdg-open", "xdg-open", page.c_str(), nullptr);
    ::_exit(127);
  }
  // It may last as long as the browser.
  std::thread([child] {
    int ended = 1;
    if (child < 0 || ::waitpid(child, &ended, 0) != child || ended != 0)
      Log("no browser could be opened from here; open the address by hand");
  }).detach();
}

/// The line that a signal prints: the command that shows the view again.
std::string GoesOn(const ViewArguments& a) {
  return fmt::format("the live view has ended; quarry view {}{}{} shows it again", a.scene,
                     a.http.empty() ? "" : " --http " + a.http,
                     a.up_axis.empty() ? "" : " --up-axis " + a.up_axis);
}

void Announce(const ViewArguments& a, const PrivateFolder& folder, const std::string& url) {
  Print(url + "\n");
  if (!FlushOutput()) Log(url);
  if (a.open) OpenBrowser(folder, url);
}

/// Lets the page say that the model could not be made into a scene, before its server ends.
void ReportFailure(const std::string& progress_file) {
  (void)WriteFileAtomically(
      progress_file,
      AsBytes(R"({"step": "failed", "done": 0, "eta_s": null, "failed": true, "message": )"
              R"("The model could not be preprocessed. The terminal of quarry view says why."})"));
  std::this_thread::sleep_for(std::chrono::seconds(2));  // the page asks each second
}

}  // namespace

void AddViewCommandOptions(CLI::App& c, ViewArguments& a) {
  c.add_option(
       "scene", a.scene,
       "A scene store (a file, or https://... or s3://BUCKET/KEY), or a model, which is preprocessed first")
      ->required();
  c.add_option(
       "--http", a.http,
       "HOST:PORT of the page (default: a free port of this machine, 8080 first; beyond loopback with "
       "--tls-cert and --tls-key)")
      ->envname("QUARRY_HTTP");
  c.add_option("--environment", a.environments,
               "A photographed sky for mode path, an image (.hdr, .exr) or its store; the page lists them");
  c.add_option("--viewer-url", a.viewer_urls, "The address at which browsers reach the page through a proxy");
  AddLocalClusterOptions(c, a.workers, a.threads, a.cache);
  c.add_option("--up-axis", a.up_axis, "y or z (default: the store's); nothing is preprocessed again")
      ->check(CLI::IsMember({"y", "z"}));
  c.add_option("--view-memory", a.view_memory,
               "Memory limit of all views together; a viewer that needs more is refused")
      ->capture_default_str();
  c.add_option("--tls-cert", a.tls_cert, "Certificate for browsers, PEM");
  c.add_option("--tls-key", a.tls_key, "Private key of --tls-cert, PEM");
  AddRemoteOptions(c, a.remote);
  AddImportOptions(c, a.import);
  c.add_flag("--open", a.open, "Open the page in a browser");
  c.add_flag("--quiet", a.quiet, "Print the address and errors only");
  c.footer(
      "Examples:\n  quarry view plant.ply --open\n"
      "  quarry view plant.quarry --http 127.0.0.1:8080     (from elsewhere: ssh -L 8080:localhost:8080 "
      "HOST)\n"
      "  quarry view plant.quarry --http 0.0.0.0:443 --tls-cert host.pem --tls-key host.key\n"
      "  quarry view plant.quarry --environment noon.hdr --environment dusk.exr\n"
      "  quarry view plant.quarry --viewer-url https://example.org/plant/");
}

Status ShowLive(const ViewArguments& a) {
  PrintOnSignal(GoesOn(a));
  QUARRY_ASSIGN(const auto folder, PrivateFolder::Make());
  QUARRY_ASSIGN(const Endpoint chosen, ChooseAddress(a));
  const std::string address = TextOf(chosen);
  QUARRY_ASSIGN(const std::string token_file, TokenFile(a, a.http.empty() ? address : a.http, *folder));
  const LiveViewOptions live{address,    a.viewer_urls, token_file, a.view_memory,
                             a.tls_cert, a.tls_key,     a.up_axis};
  std::string store, url;
  {
    // A store needs no page of progress; a model may take long.
    std::unique_ptr<PreparingPage> page;
    if (std::error_code error; fs::exists(a.scene, error) && !a.scene.ends_with(".quarry")) {
      const std::string progress = folder->file("progress");
      QUARRY_ASSIGN(page, PreparingPage::Start(a.scene, live, progress));
      url = page->url();
      Announce(a, *folder, url);
      ::setenv("QUARRY_PROGRESS_FILE", progress.c_str(), 1);
    }
    if (IsRemote(a.scene)) QUARRY_TRY(RefuseImportOptions(a.import, a.scene + " is a store"));
    auto made = IsRemote(a.scene) ? Result<std::string>(a.scene) : StoreFor(a.scene, a.import, a.quiet);
    if (!made) {
      if (page) ReportFailure(folder->file("progress"));
      return tl::unexpected<Error>(made.error());
    }
    PrintOnSignal(GoesOn(a));
    store = std::move(*made);
    ::unsetenv("QUARRY_PROGRESS_FILE");
  }
  std::vector<std::string> environments;
  for (const std::string& place : a.environments) {
    QUARRY_ASSIGN(environments.emplace_back(), EnvironmentStoreFor(place, a.quiet));
  }
  const auto say = [&](const std::string& line) {
    if (!a.quiet) Log(line);
  };
  QUARRY_ASSIGN(const auto cluster, LocalCluster::Start({.scene = store,
                                                         .environments = environments,
                                                         .workers = a.workers,
                                                         .threads = a.threads,
                                                         .cache = a.cache,
                                                         .security = {},
                                                         .remote = a.remote,
                                                         .live = live,
                                                         .lasting = true,
                                                         .say = say}));
  if (cluster->live_url() != url) Announce(a, *folder, cluster->live_url());
  if (!a.quiet) Log(fmt::format("{} is shown until Ctrl-C", a.scene));
  while (true) {
    QUARRY_TRY(cluster->Check());
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
}

}  // namespace quarry
