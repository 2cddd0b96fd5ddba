#include "preprocess/import/decompressor.h"

#include <fmt/format.h>
#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>
#include <atomic>
#include <bit>

namespace quarry {
namespace {

class Gunzip : public Decompressor {
 public:
  Gunzip() { ready_ = inflateInit2(&stream_, 15 + 16) == Z_OK; }  // 16 selects gzip's header and checksum
  ~Gunzip() override { inflateEnd(&stream_); }

  Step Run(std::span<const char> in, std::span<char> out) override {
    if (!ready_) return {0, 0, "gzip: zlib does not start"};
    // Zeros and other bytes after the last member are ignored, as gzip does.
    if (at_end_ && !in.empty() && in.front() != '\x1F') return {in.size(), 0, {}};
    if (at_end_ && !in.empty()) {
      inflateReset(&stream_);
      at_end_ = false;
    }
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(in.data()));
    stream_.avail_in = static_cast<uInt>(in.size());
    stream_.next_out = reinterpret_cast<Bytef*>(out.data());
    stream_.avail_out = static_cast<uInt>(out.size());
    const int result = inflate(&stream_, Z_NO_FLUSH);
    Step step{in.size() - stream_.avail_in, out.size() - stream_.avail_out, {}};
    at_end_ = result == Z_STREAM_END;
    if (result != Z_OK && result != Z_STREAM_END && result != Z_BUF_ERROR)
      step.error = std::string("damaged gzip: ") + (stream_.msg ? stream_.msg : "cannot be unpacked");
    return step;
  }
  bool AtEnd() const override { return at_end_; }

 private:
  z_stream stream_{};
  bool ready_ = false, at_end_ = false;
};

constexpr int kMostWindowLog = 27;  // zstd's own limit
std::atomic<int> window_limit_log{kMostWindowLog};

class Unzstd : public Decompressor {
 public:
  explicit Unzstd(std::string_view start) : context_(ZSTD_createDCtx()) {
    ZSTD_DCtx_setParameter(context_, ZSTD_d_windowLogMax, window_limit_log);
    // The frame's header gives the window, unless it states that the content is a single segment.
    constexpr unsigned kOneSegment = 0x20;
    if (start.size() > 5 && (static_cast<unsigned char>(start[4]) & kOneSegment) == 0) {
      const auto window = static_cast<unsigned char>(start[5]);
      window_log_ = 10 + (window >> 3) + ((window & 7) != 0);
    }
  }
  ~Unzstd() override { ZSTD_freeDCtx(context_); }

  Step Run(std::span<const char> in, std::span<char> out) override {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out.data(), out.size(), 0};
    const size_t left = ZSTD_decompressStream(context_, &to, &from);
    Step step{from.pos, to.pos, {}};
    if (ZSTD_getErrorCode(left) == ZSTD_error_frameParameter_windowTooLarge)
      step.error = fmt::format("its window is too large for the memory; {}unpack it with zstd -d --long={}",
                               window_log_ <= kMostWindowLog ? "give more --memory, or " : "", window_log_);
    else if (ZSTD_isError(left) != 0)
      step.error = std::string("damaged zstd: ") + ZSTD_getErrorName(left);
    if (step.taken != 0 || step.given != 0) at_end_ = left == 0;
    return step;
  }
  bool AtEnd() const override { return at_end_; }

 private:
  ZSTD_DCtx* context_;
  int window_log_ = 31;  // zstd's maximum
  bool at_end_ = false;
};

}  // namespace

void LimitZstdWindow(uint64_t bytes) {
  window_limit_log = std::clamp(static_cast<int>(std::bit_width(bytes)) - 1, 10, kMostWindowLog);
}

std::unique_ptr<Decompressor> MakeDecompressor(std::string_view start) {
  if (start.starts_with("\x1F\x8B")) return std::make_unique<Gunzip>();
  if (start.starts_with("\x28\xB5\x2F\xFD")) return std::make_unique<Unzstd>(start);
  return nullptr;
}

}  // namespace quarry
