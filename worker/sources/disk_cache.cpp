#include "worker/sources/disk_cache.h"

#include <fmt/format.h>

#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <unordered_map>
#include <utility>

#include "common/base/size.h"
#include "worker/sources/cache_folder.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

// Bytes; a slow disk must not hold an unbounded amount of memory.
constexpr uint64_t kMaxQueuedBytes = 4 << 20;
constexpr int kReadsInARow = 8;  // reads before a write or a sweep gets its turn
// Pause after a failed write, so that a full disk does not cost a failing write for each block.
constexpr auto kWritePause = std::chrono::minutes(1);

}  // namespace

struct DiskCachedSource::Impl : std::enable_shared_from_this<DiskCachedSource::Impl> {
  using Guard = boost::asio::executor_work_guard<boost::asio::io_context::executor_type>;
  struct Waiting {
    BlockKey block;
    Done done;
    Guard guard;  // keeps the io_context running while the disk is read
  };
  struct Read {
    uint64_t ticket;
    BlockKey block;
  };
  struct Write {
    BlockKey block;
    Bytes bytes;
  };

  Impl(boost::asio::io_context& context, VoxelSource& source, const DiskCacheLocation& location,
       const Catalog& c, Log to)
      : io(context), inner(source), catalog(c), log(std::move(to)), folder(location.folder, location.bytes) {}

  // On the io_context's thread.

  void Fetch(BlockKey block, Done done) {
    if (!catalog.Has(block)) return inner.Fetch(block, std::move(done));
    const uint64_t ticket = next_ticket++;
    waiting.emplace(ticket, Waiting{block, std::move(done), Guard(io.get_executor())});
    {
      const std::lock_guard lock(mutex);
      reads.push_back({ticket, block});
    }
    wake.notify_one();
  }

  /// Handles a finished read. `bytes` is empty when the folder does not have the block.
  void OnRead(uint64_t ticket, std::optional<Bytes> bytes) {
    const auto found = waiting.find(ticket);
    if (stopped || found == waiting.end()) return;
    Waiting w = std::move(found->second);
    waiting.erase(found);
    if (bytes) return w.done(std::move(*bytes));
    inner.Fetch(w.block,
                [self = shared_from_this(), block = w.block, done = std::move(w.done)](Result<Bytes> got) {
                  if (self->stopped) return;
                  if (got) self->Keep(block, *got);
                  done(std::move(got));
                });
  }

  void Keep(BlockKey block, const Bytes& bytes) {
    {
      const std::lock_guard lock(mutex);
      if (!writes.empty() && queued_bytes + bytes.size() > kMaxQueuedBytes) {
        ++not_written;
        return;
      }
      queued_bytes += bytes.size();
      writes.push_back({block, bytes});
    }
    wake.notify_one();
  }

  // On the disk's thread.

  void Run() {
    if (const Status status = folder.Open(); !status) PauseWrites(status.error());
    std::unique_lock lock(mutex);
    for (int in_a_row = 0; !(stopping && writes.empty());) {
      if (!stopping && !reads.empty() && in_a_row < kReadsInARow) {
        ++in_a_row;
        const Read read = reads.front();
        reads.pop_front();
        lock.unlock();
        DoRead(read);
      } else if (const bool sweep = !stopping && folder.SweepDue(); sweep || !writes.empty()) {
        // Alternates between writes and sweeping: neither may delay the other for long.
        in_a_row = 0;
        sweep_next = !sweep_next;
        std::optional<Write> write;
        if (!writes.empty() && !(sweep && sweep_next)) {
          write = std::move(writes.front());
          writes.pop_front();
          queued_bytes -= write->bytes.size();
        }
        lock.unlock();
        write ? DoWrite(*write) : folder.Sweep();
        evicted = folder.evicted();
      } else if (!reads.empty()) {
        in_a_row = 0;
        continue;
      } else {
        wake.wait(lock);
        continue;
      }
      lock.lock();
    }
  }

  void DoRead(const Read& read) {
    std::optional<Bytes> bytes(std::in_place);
    const auto found =
        folder.Read(catalog.id, catalog.NumberOf(read.block), catalog.block(read.block), *bytes);
    if (!found) WarnOnce(warned_read, found.error().message + "; blocks are fetched without the disk cache");
    if (found && *found == CacheFolder::Found::kDamaged) ++damaged;
    if (found && *found == CacheFolder::Found::kYes) {
      ++hits;
      bytes_read += bytes->size();
    } else {
      ++misses;
      bytes.reset();
    }
    boost::asio::post(io, [self = shared_from_this(), ticket = read.ticket,
                           bytes = std::move(bytes)]() mutable { self->OnRead(ticket, std::move(bytes)); });
  }

  void DoWrite(const Write& write) {
    const BlockEntry& entry = catalog.block(write.block);
    const bool right = write.bytes.size() == entry.stored && Checksum(write.bytes) == entry.checksum;
    if (!right || Clock::now() < write_again) {
      ++not_written;
      return;
    }
    const uint32_t number = catalog.NumberOf(write.block);
    if (const Status status = folder.Write(catalog.id, number, write.bytes); !status) {
      ++not_written;
      return PauseWrites(status.error());
    }
    bytes_written += write.bytes.size();
  }

  void PauseWrites(const Error& error) {
    write_again = Clock::now() + kWritePause;
    WarnOnce(warned_write, error.message + "; the disk cache continues without writing");
  }

  void WarnOnce(bool& warned, std::string sentence) {
    if (std::exchange(warned, true)) return;
    boost::asio::post(io, [self = shared_from_this(), sentence = std::move(sentence)] {
      if (!self->stopped && self->log) self->log(sentence);
    });
  }

  boost::asio::io_context& io;
  VoxelSource& inner;
  const Catalog& catalog;
  Log log;
  std::unordered_map<uint64_t, Waiting> waiting;  // waiting for the disk
  uint64_t next_ticket = 0;
  bool stopped = false;

  CacheFolder folder;
  Clock::time_point write_again;
  bool warned_read = false, warned_write = false, sweep_next = false;

  std::mutex mutex;
  std::condition_variable wake;
  std::deque<Read> reads;
  std::deque<Write> writes;
  uint64_t queued_bytes = 0;
  bool stopping = false;

  std::atomic<uint64_t> hits{0}, misses{0}, bytes_read{0}, bytes_written{0}, damaged{0}, not_written{0},
      evicted{0};
  std::thread thread;
};

Result<DiskCacheLocation> ParseDiskCache(const std::string& text, const std::string& what) {
  const size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0)
    return BadUsage(fmt::format("{} is not DIR:BYTES: '{}' (such as /var/cache/quarry:20G)", what, text));
  DiskCacheLocation location;
  location.folder = text.substr(0, colon);
  QUARRY_ASSIGN(location.bytes, ParseSize(text.substr(colon + 1), what));
  if (location.bytes == 0) return BadUsage(fmt::format("{} has a size of 0: leave it out instead", what));
  return location;
}

DiskCachedSource::DiskCachedSource(boost::asio::io_context& io, VoxelSource& inner,
                                   const DiskCacheLocation& location, const Catalog& catalog, Log log)
    : impl_(std::make_shared<Impl>(io, inner, location, catalog, std::move(log))) {
  impl_->thread = std::thread([impl = impl_.get()] { impl->Run(); });
}

DiskCachedSource::DiskCachedSource(boost::asio::io_context& io, std::unique_ptr<VoxelSource> inner,
                                   const DiskCacheLocation& location, const Catalog& catalog, Log log)
    : DiskCachedSource(io, *inner, location, catalog, std::move(log)) {
  owned_ = std::move(inner);
}

DiskCachedSource::~DiskCachedSource() { Close(); }

void DiskCachedSource::Close() {
  if (std::exchange(impl_->stopped, true)) return;
  impl_->waiting.clear();
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->stopping = true;
  }
  impl_->wake.notify_one();
  impl_->thread.join();
}

void DiskCachedSource::Fetch(BlockKey block, Done done) { impl_->Fetch(block, std::move(done)); }

DiskCachedSource::Counters DiskCachedSource::counters() const {
  const Impl& i = *impl_;
  return {i.hits, i.misses, i.bytes_read, i.bytes_written, i.damaged, i.not_written, i.evicted};
}

}  // namespace quarry
