#include "tests/support/servers/nginx.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

namespace quarry::test {
namespace {

sockaddr_in Loopback(uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  return address;
}

/// A port that is free now.
uint16_t FreePort() {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address = Loopback(0);
  socklen_t size = sizeof address;
  ::bind(fd, reinterpret_cast<sockaddr*>(&address), size);
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
  ::close(fd);
  return ntohs(address.sin_port);
}

bool Answers(uint16_t port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = Loopback(port);
  const bool connected = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::close(fd);
  return connected;
}

}  // namespace

std::string Nginx::Program() {
  for (const char* path : {"/usr/sbin/nginx", "/usr/bin/nginx", "/usr/local/sbin/nginx"})
    if (::access(path, X_OK) == 0) return path;
  return "";
}

Result<std::unique_ptr<Nginx>> Nginx::Start(const std::string& folder, const std::string& root,
                                            const std::string& locations, const std::string& certificate) {
  std::filesystem::create_directories(folder);
  for (int attempt = 0; attempt < 5; ++attempt) {
    const uint16_t port = FreePort();
    const std::string configuration = folder + "/nginx.conf";
    std::ofstream(configuration) << fmt::format(
        "daemon off; worker_processes 1; pid {0}/pid; error_log {0}/error.log;\n{5}"
        "events {{ worker_connections 256; }}\n"
        "http {{ access_log off; default_type application/octet-stream; keepalive_requests 100000;\n"
        "  client_body_temp_path {0}/t1; proxy_temp_path {0}/t2; fastcgi_temp_path {0}/t3;\n"
        "  uwsgi_temp_path {0}/t4; scgi_temp_path {0}/t5;\n"
        "  server {{ listen 127.0.0.1:{1}{3}; server_name localhost; root {2}; {4}\n  }}\n}}\n",
        folder, port, root, certificate.empty() ? "" : " ssl",
        certificate.empty()
            ? locations
            : fmt::format("ssl_certificate {0}; ssl_certificate_key {0}; {1}", certificate, locations),
        ::geteuid() == 0 ? "user root;\n" : "");
    const pid_t pid = ::fork();
    if (pid < 0) return Fail("cannot start nginx");
    if (pid == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGTERM);
      const int log = ::open((folder + "/output").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
      ::dup2(log, 1);
      ::dup2(log, 2);
      ::execl(Program().c_str(), "nginx", "-p", folder.c_str(), "-c", configuration.c_str(), "-e",
              (folder + "/error.log").c_str(), nullptr);
      ::_exit(127);
    }
    std::unique_ptr<Nginx> nginx(new Nginx);
    nginx->pid_ = pid;
    nginx->port_ = port;
    for (int i = 0; i < 1000; ++i) {
      if (Answers(port)) return nginx;
      if (::waitpid(pid, nullptr, WNOHANG) == pid) {
        nginx->pid_ = -1;  // another program took the port meanwhile
        break;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  return Fail(fmt::format("nginx does not start: see {}/output", folder));
}

Nginx::~Nginx() {
  if (pid_ <= 0) return;
  ::kill(pid_, SIGTERM);
  ::waitpid(pid_, nullptr, 0);
}

}  // namespace quarry::test
