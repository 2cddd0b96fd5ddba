#include "preprocess/import/gltf/gltf_decoded.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <utility>

namespace quarry {

GltfDecoded::GltfDecoded(GltfDecoded&& other) noexcept
    : decoding_(std::move(other.decoding_)),
      fd_(std::exchange(other.fd_, -1)),
      size_(other.size_),
      views_(std::move(other.views_)),
      elements_(other.elements_) {}

GltfDecoded::~GltfDecoded() {
  if (fd_ >= 0) ::close(fd_);
}

Status GltfDecoded::Create() {
  if (fd_ >= 0) return {};
  std::error_code none;
  const std::string folder =
      decoding_.folder.empty() ? std::filesystem::temp_directory_path(none).string() : decoding_.folder;
  std::string name = folder + "/quarry-decoded-XXXXXX";
  fd_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd_ < 0)
    return Fail(fmt::format("{}: a file for decoded bytes cannot be made: {}", folder, ErrnoText(errno)));
  ::unlink(name.c_str());
  return {};
}

Result<uint64_t> GltfDecoded::Append(std::span<const std::byte> bytes) {
  QUARRY_TRY(Create());
  if (bytes.size() > kMostBytes - size_)
    return Fail(fmt::format("its compressed parts take more than {} GiB when decoded", kMostBytes >> 30));
  const uint64_t offset = size_;
  while (!bytes.empty()) {
    const ssize_t n = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(size_));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0)
      return Fail(fmt::format("decoded bytes cannot be written: {}", ErrnoText(n < 0 ? errno : ENOSPC)));
    size_ += static_cast<uint64_t>(n);
    bytes = bytes.subspan(static_cast<size_t>(n));
  }
  return offset;
}

Status GltfDecoded::Read(uint64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const ssize_t n = ::pread(fd_, out.data(), out.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return Fail(fmt::format("decoded bytes cannot be read: {}", ErrnoText(n < 0 ? errno : EIO)));
    offset += static_cast<uint64_t>(n);
    out = out.subspan(static_cast<size_t>(n));
  }
  return {};
}

const GltfElements* GltfDecoded::FindElements(uint64_t accessor) const {
  if (!elements_) return nullptr;
  const auto found = elements_->find(accessor);
  return found == elements_->end() ? nullptr : &found->second;
}

std::optional<uint64_t> GltfDecoded::FindView(uint64_t view) const {
  const auto found = views_.find(view);
  return found == views_.end() ? std::nullopt : std::optional(found->second);
}

}  // namespace quarry
