#include "preprocess/texture/image_decoder.h"

#include <fmt/format.h>
#include <sys/wait.h>

#include <csignal>
#include <utility>
#include <vector>

#include "common/base/descriptor.h"
#include "common/voxel/texture_shape.h"
#include "preprocess/import/foreign/child_environment.h"

namespace quarry {
namespace {

/// "FILE, image NAME of MODEL", shorter if that repeats itself.
std::string NameOf(const TextureImage& image) {
  if (image.model == image.file) return image.file;
  return image.file.ends_with(image.name) ? fmt::format("{} (of {})", image.file, image.model)
                                          : fmt::format("{}, image {}", image.model, image.name);
}

tl::unexpected<Error> Refused(const TextureImage& image, const std::string& why) {
  return Fail(fmt::format("{}: cannot be read as an image: {}", NameOf(image), why));
}

}  // namespace

Status ImageDecoder::Start() {
  if (helper_.program().empty())
    return Fail(
        "quarry-import-image is not installed with this program, so images cannot be read; --no-textures "
        "leaves them out");
  return helper_.Start();
}

/// The helper has ended; the result is the reason.
tl::unexpected<Error> ImageDecoder::Ended(const TextureImage& image) {
  const int status = helper_.Wait();
  if (!answered_ && WIFEXITED(status)) {
    fatal_ = true;
    if (WEXITSTATUS(status) == kNoLibrary)
      return Fail(
          fmt::format("{}: {} lacks shared libraries: install OpenImageIO (Debian's package "
                      "libopenimageio2.4), or give --no-textures",
                      NameOf(image), helper_.program()));
    return Fail(
        fmt::format("{}: the process that decodes it, {}, has ended before its first answer (status {})",
                    NameOf(image), helper_.program(), WEXITSTATUS(status)));
  }
  const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  if (signal == SIGXCPU) {  // leaving the image out would make the store depend on the machine's speed
    fatal_ = true;
    return Fail(fmt::format("{}: took its decoder more than ten minutes; --no-textures leaves images out",
                            NameOf(image)));
  }
  // The kernel kills so when memory is short, and so do people: the image is not at fault.
  fatal_ = signal == SIGKILL || signal == SIGTERM || signal == SIGINT || signal == SIGHUP;
  if (fatal_)
    return Fail(fmt::format("{}: the process that decodes it was ended by signal {}", NameOf(image), signal));
  return Refused(image, "the decoder has crashed on it");
}

Status ImageDecoder::Ask(ImageMessage kind, const TextureImage& image) {
  fatal_ = true;
  QUARRY_TRY(Start());
  fatal_ = false;
  ByteWriter request;
  request.Put(static_cast<uint32_t>(kind));
  request.Put(static_cast<uint32_t>(16 + image.file.size()));
  request.Put(image.offset);
  request.Put(image.size);
  request.PutArray(image.file);
  return WriteAll(helper_.to(), request.bytes()) ? Status{} : Ended(image);
}

Result<ImageDecoder::Message> ImageDecoder::Receive(const TextureImage& image) {
  std::byte header[kImageHeaderBytes];
  if (!ReadAll(helper_.from(), header)) return Ended(image);
  ByteReader in(header);
  Message message{static_cast<ImageMessage>(in.Get<uint32_t>()), {}};
  const auto size = in.Get<uint32_t>();
  if (size > kMostImageMessage) {
    helper_.Stop();
    return Refused(image, "the decoder gives an invalid answer");
  }
  message.bytes.resize(size);
  if (!ReadAll(helper_.from(), message.bytes)) return Ended(image);
  answered_ = true;
  if (message.kind == ImageMessage::kTooLarge) {
    fatal_ = true;
    return Fail(fmt::format("{}: needs more than --memory to be decoded: {}; give more, or --no-textures",
                            NameOf(image), AsText(message.bytes)));
  }
  if (message.kind == ImageMessage::kRefused) return Refused(image, std::string(AsText(message.bytes)));
  return message;
}

Result<ImageFacts> ImageDecoder::ReceiveFacts(const TextureImage& image) {
  QUARRY_ASSIGN(const Message message, Receive(image));
  ByteReader in(message.bytes);
  ImageFacts facts;
  for (uint32_t* fact : {&facts.width, &facts.height, &facts.channels, &facts.real, &facts.encoded})
    *fact = in.Get<uint32_t>();
  // A decoder that was misled by its input may send anything.
  if (message.kind != ImageMessage::kFacts || !in.done() || facts.channels - 1 > 3 ||
      facts.width - 1 >= kMaxTextureSide || facts.height - 1 >= kMaxTextureSide) {
    helper_.Stop();
    return Refused(image, "the decoder gives an invalid answer");
  }
  return facts;
}

Status ImageDecoder::Decode(const TextureImage& image, const OnFacts& on_facts, const OnRow& on_row) {
  uint64_t row_bytes = 1;
  return DecodeRows(
      image,
      [&](const ImageFacts& facts) {
        row_bytes = facts.row_bytes();
        return on_facts(facts);
      },
      [&](const Bytes& rows) -> Status {
        for (uint64_t at = 0; at < rows.size(); at += row_bytes)
          QUARRY_TRY(on_row(std::span(rows).subspan(at, row_bytes)));
        return {};
      });
}

Status ImageDecoder::DecodeRows(const TextureImage& image, const OnFacts& on_facts, const OnRows& on_rows) {
  remark_.clear();
  QUARRY_TRY(Ask(ImageMessage::kDecode, image));
  QUARRY_ASSIGN(const ImageFacts facts, ReceiveFacts(image));
  const auto given = [&](Status status) {
    fatal_ = !status;
    if (!status) helper_.Stop();  // rows are in flight
    return status;
  };
  QUARRY_TRY(given(on_facts(facts)));
  uint64_t rows = 0;
  for (;;) {
    QUARRY_ASSIGN(Message message, Receive(image));
    if (message.kind == ImageMessage::kEnd && rows == facts.height) {
      if (!message.bytes.empty())
        remark_ = fmt::format("{}: is read, but its decoder reports: {}", NameOf(image),
                              AsText(message.bytes).substr(0, 1000));
      return {};
    }
    const uint64_t count = message.bytes.size() / facts.row_bytes();
    if (message.kind != ImageMessage::kRows || count * facts.row_bytes() != message.bytes.size() ||
        rows + count > facts.height) {
      helper_.Stop();
      return Refused(image, "the decoder gives other rows than it announced");
    }
    rows += count;
    QUARRY_TRY(given(on_rows(std::move(message.bytes))));
  }
}

Result<ImageFacts> ImageDecoder::LookAt(const TextureImage& image) {
  QUARRY_TRY(Ask(ImageMessage::kLookAt, image));
  QUARRY_ASSIGN(const ImageFacts facts, ReceiveFacts(image));
  QUARRY_TRY(Receive(image).map([](auto&&) {}));  // the end message
  return facts;
}

}  // namespace quarry
