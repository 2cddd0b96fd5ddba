// quarry-import-image BYTES: decodes images for quarry-preprocess, which starts it and speaks to it through
// standard input and output (image_protocol.h). May use BYTES of address space beyond the program's own. It
// is a process of its own because decoders of foreign bytes may crash, and because OpenImageIO's libraries
// take 100 MB.

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <new>
#include <optional>
#include <string>

#include "common/base/address_space.h"
#include "common/base/bytes.h"
#include "common/base/descriptor.h"
#include "common/base/log.h"
#include "common/program/processor_time.h"
#include "common/program/run_helper.h"
#include "preprocess/texture/image_decoding.h"
#include "preprocess/texture/image_protocol.h"

namespace quarry {
namespace {

/// Address space that OpenImageIO takes for any image: a buffer of 64 MB, of which it touches one row.
constexpr uint64_t kOwnBytes = 96u << 20;
constexpr rlim_t kMostSecondsOfImage = 600;

void Send(int fd, ImageMessage kind, std::span<const std::byte> bytes) {
  ByteWriter header;
  header.Put(static_cast<uint32_t>(kind));
  header.Put(static_cast<uint32_t>(bytes.size()));
  // The parent is gone: nothing is left to do.
  if (!WriteAll(fd, header.bytes()) || !WriteAll(fd, bytes)) std::_Exit(1);
}

void SendFacts(int fd, const ImageFacts& facts) {
  ByteWriter out;
  for (const uint32_t fact : {facts.width, facts.height, facts.channels, facts.real, facts.encoded})
    out.Put(fact);
  Send(fd, ImageMessage::kFacts, out.bytes());
}

/// Removes the path, which libraries put into their sentences.
std::string WithoutPath(std::string why, const std::string& path) {
  for (const std::string& name : {path + ": ", path})
    for (size_t at = why.find(name); !name.empty() && at != std::string::npos; at = why.find(name, at))
      why.erase(at, name.size());
  return why;
}

/// Whether a decoder's sentence means too little memory: OpenImageIO catches exceptions, and its libraries
/// write sentences of their own.
bool OfMemory(const std::string& why) {
  for (const char* word : {"alloc", "memory", "Memory", "No space"})
    if (why.find(word) != std::string::npos) return true;
  return false;
}

/// The facts known about an image when its decoder runs out of memory.
struct Known {
  uint64_t file_bytes = 0;  ///< of the image, compressed
  std::optional<ImageFacts> facts;
};

/// Whether a sound image may have needed more than `memory` bytes. A damaged header asks for any number.
bool NeedsSoMuch(const Known& known, uint64_t memory) {
  constexpr uint64_t kMostRatio = 1100;                    // of compression: deflate's is 1032
  constexpr uint64_t kMostSampleBytes = 4;                 // a float
  if (!known.facts) return known.file_bytes > memory / 2;  // opening takes at most the file
  const uint64_t decoded =
      uint64_t{known.facts->width} * known.facts->height * known.facts->in_file * kMostSampleBytes;
  return decoded + known.file_bytes > memory / 2 && decoded / kMostRatio <= known.file_bytes;
}

void SendShortage(int out, const Known& known, uint64_t memory, const std::string& why) {
  if (NeedsSoMuch(known, memory)) return Send(out, ImageMessage::kTooLarge, AsBytes(why));
  Send(out, ImageMessage::kRefused, AsBytes("is damaged: it asks for more memory than such an image takes"));
}

void Answer(int out, ImageMessage kind, std::span<const std::byte> request, uint64_t memory) {
  ByteReader in(request);
  const auto offset = in.Get<uint64_t>(), size = in.Get<uint64_t>();
  const std::string path(AsText(in.GetSpan(in.remaining())));
  std::error_code ignored;
  const uint64_t whole = std::filesystem::file_size(path, ignored);
  Known known{ignored || whole < offset ? 0 : std::min(size, whole - offset), std::nullopt};
  try {
    const Result<std::string> done = DecodeImage(
        path, offset, size, kind == ImageMessage::kLookAt,
        [&](const ImageFacts& facts) {
          known.facts = facts;
          SendFacts(out, facts);
        },
        [&](std::span<const std::byte> rows) { Send(out, ImageMessage::kRows, rows); });
    if (done) return Send(out, ImageMessage::kEnd, AsBytes(WithoutPath(*done, path)));
    const std::string why = WithoutPath(done.error().message, path);
    if (OfMemory(why)) return SendShortage(out, known, memory, why);
    Send(out, ImageMessage::kRefused, AsBytes(why));
  } catch (const std::bad_alloc&) {
    SendShortage(out, known, memory, "the decoder holds it whole");
  } catch (const std::exception& e) {
    const std::string why = WithoutPath(Refusal(e.what()), path);
    if (OfMemory(why)) return SendShortage(out, known, memory, why);
    Send(out, ImageMessage::kRefused, AsBytes(why));
  }
}

int Serve(uint64_t memory, int out) {
  PrepareDecoding();  // its memory counts as the program's own
  LimitAddressSpace(kOwnBytes + memory);
  for (;;) {
    std::byte header[kImageHeaderBytes];
    if (!ReadAll(0, header)) return 0;
    ByteReader in(header);
    const auto kind = static_cast<ImageMessage>(in.Get<uint32_t>());
    Bytes request(std::min(in.Get<uint32_t>(), kMostImageMessage));
    if (!ReadAll(0, request)) return 0;
    LimitProcessorTime(kMostSecondsOfImage);
    Answer(out, kind, request, memory);
  }
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunHelper<quarry::Serve>("quarry-import-image", argc, argv);
}
