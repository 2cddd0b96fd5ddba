#include "preprocess/import/decompressor.h"

#include <zlib.h>
#include <zstd.h>

namespace quarry {
namespace {

class Gunzip : public Decompressor {
 public:
  Gunzip() { ready_ = inflateInit2(&stream_, 15 + 16) == Z_OK; }  // 16: gzip's header and checksum
  ~Gunzip() override { inflateEnd(&stream_); }

  Step Run(std::span<const char> in, std::span<char> out) override {
    if (!ready_) return {0, 0, "gzip: zlib does not start"};
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

class Unzstd : public Decompressor {
 public:
  Unzstd() : context_(ZSTD_createDCtx()) {}
  ~Unzstd() override { ZSTD_freeDCtx(context_); }

  Step Run(std::span<const char> in, std::span<char> out) override {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out.data(), out.size(), 0};
    const size_t left = ZSTD_decompressStream(context_, &to, &from);
    Step step{from.pos, to.pos, {}};
    if (ZSTD_isError(left) != 0) step.error = std::string("damaged zstd: ") + ZSTD_getErrorName(left);
    if (step.taken != 0 || step.given != 0) at_end_ = left == 0;
    return step;
  }
  bool AtEnd() const override { return at_end_; }

 private:
  ZSTD_DCtx* context_;
  bool at_end_ = false;
};

}  // namespace

std::unique_ptr<Decompressor> MakeDecompressor(std::string_view start) {
  if (start.starts_with("\x1F\x8B")) return std::make_unique<Gunzip>();
  if (start.starts_with("\x28\xB5\x2F\xFD")) return std::make_unique<Unzstd>();
  return nullptr;
}

}  // namespace quarry
