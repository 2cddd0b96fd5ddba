#include "tests/scalability/mapped_blocks.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/userfaultfd.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "common/engine/blocks/loader.h"

namespace quarry::bench {
namespace {

Error SystemError(const char* what) { return Error{fmt::format("{}: {}", what, std::strerror(errno))}; }

Result<std::span<std::byte>> Map(size_t bytes) {
  void* at =
      ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED) return tl::unexpected<Error>(SystemError("no memory for the decoded store"));
  return std::span(static_cast<std::byte*>(at), bytes);
}

}  // namespace

std::string MappedBlocks::WhyNot() {
  const auto descriptor = static_cast<int>(::syscall(SYS_userfaultfd, O_CLOEXEC));
  if (descriptor < 0) return SystemError("userfaultfd").message;
  ::close(descriptor);
  return {};
}

Result<std::unique_ptr<MappedBlocks>> MappedBlocks::Make(const StoreReader& store, Line& line) {
  std::unique_ptr<MappedBlocks> self(new MappedBlocks(line));
  QUARRY_TRY(self->Decode(store));
  QUARRY_TRY(self->HandFaultsOn());
  return self;
}

MappedBlocks::~MappedBlocks() {
  if (server_.joinable()) {
    const uint64_t one = 1;
    if (::write(stop_, &one, sizeof one) == sizeof one) server_.join();
  }
  for (const int descriptor : {faults_, stop_})
    if (descriptor >= 0) ::close(descriptor);
  for (const auto& mapping : {region_, file_})
    if (!mapping.empty()) ::munmap(mapping.data(), mapping.size());
}

/// Decodes into the region, then copies into the file from which chunks are read.
Status MappedBlocks::Decode(const StoreReader& store) {
  constexpr size_t kAlignment = 64;
  const Catalog& catalog = store.catalog();
  const auto room = [](const BlockEntry& entry) {
    return (size_t{entry.decoded} + kAlignment - 1) / kAlignment * kAlignment;
  };
  size_t bytes = 0;
  for (const VoxelEntry& voxel : catalog.voxels)
    for (const BlockEntry& entry : voxel.blocks) bytes += room(entry);
  bytes = (bytes + kChunk - 1) / kChunk * kChunk;
  QUARRY_ASSIGN(region_, Map(bytes));
  QUARRY_ASSIGN(file_, Map(bytes));
  blocks_.resize(catalog.voxel_blocks());
  BlockDecoder decoder;
  size_t at = 0;
  for (uint32_t number = 0; number < blocks_.size(); ++number) {
    const std::optional<BlockKey> id = catalog.BlockOf(number);
    if (!id) continue;
    const BlockEntry& entry = catalog.block(*id);
    QUARRY_ASSIGN(const Bytes stored, store.ReadBlock(*id));
    const std::span out = region_.subspan(at, entry.decoded);
    blocks_[number] = std::make_unique<ResidentBlock>();
    if (id->kind() == BlockKind::kShading) {
      QUARRY_ASSIGN(blocks_[number]->shading, decoder.Shading(stored, out));
    } else {
      QUARRY_ASSIGN(blocks_[number]->hot, DecodeHot(decoder, catalog, id->index(), stored, out));
    }
    at += room(entry);
  }
  std::memcpy(file_.data(), region_.data(), bytes);
  return {};
}

Status MappedBlocks::HandFaultsOn() {
  if (::madvise(region_.data(), region_.size(), MADV_DONTNEED) != 0)
    return tl::unexpected<Error>(SystemError("madvise"));
  faults_ = static_cast<int>(::syscall(SYS_userfaultfd, O_CLOEXEC | O_NONBLOCK));
  stop_ = ::eventfd(0, EFD_CLOEXEC);
  uffdio_api api{};
  api.api = UFFD_API;
  uffdio_register where{};
  where.range = {reinterpret_cast<uintptr_t>(region_.data()), region_.size()};
  where.mode = UFFDIO_REGISTER_MODE_MISSING;
  if (faults_ < 0 || stop_ < 0 || ::ioctl(faults_, UFFDIO_API, &api) != 0 ||
      ::ioctl(faults_, UFFDIO_REGISTER, &where) != 0)
    return tl::unexpected<Error>(SystemError("userfaultfd"));
  server_ = std::thread([this] { Serve(); });
  return {};
}

void MappedBlocks::Serve() {
  const auto base = reinterpret_cast<uintptr_t>(region_.data());
  pollfd wanted[2] = {{faults_, POLLIN, 0}, {stop_, POLLIN, 0}};
  for (;;) {
    if (::poll(wanted, 2, -1) < 0) continue;
    if (wanted[1].revents != 0) return;
    uffd_msg message;
    if (::read(faults_, &message, sizeof message) != sizeof message || message.event != UFFD_EVENT_PAGEFAULT)
      continue;
    const size_t first = (message.arg.pagefault.address - base) / kChunk * kChunk;
    std::this_thread::sleep_until(line_.Ask(kChunk));
    uffdio_copy copy{};
    copy.dst = base + first;
    copy.src = reinterpret_cast<uintptr_t>(file_.data()) + first;
    copy.len = kChunk;
    // The chunk is resident already when another thread waited for it too; the thread only has to be woken.
    if (::ioctl(faults_, UFFDIO_COPY, &copy) != 0) {
      uffdio_range range{base + first, kChunk};
      ::ioctl(faults_, UFFDIO_WAKE, &range);
    }
  }
}

}  // namespace quarry::bench
