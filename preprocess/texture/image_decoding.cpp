#include "preprocess/texture/image_decoding.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <type_traits>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/voxel/texture_shape.h"

namespace quarry {
namespace {

constexpr uint64_t kRowsBytes = 1u << 20;  // bytes of rows a message, about

/// A part of a file, presented as a file.
class FilePart : public OIIO::Filesystem::IOProxy {
 public:
  FilePart(const InputFile& file, uint64_t offset, uint64_t size)
      : IOProxy(file.path(), Read), file_(file), offset_(offset), size_(size) {}
  const char* proxytype() const override { return "part"; }
  size_t size() const override { return size_; }
  size_t read(void* out, size_t wanted) override {
    const size_t got = pread(out, wanted, m_pos);
    m_pos += static_cast<int64_t>(got);
    return got;
  }
  size_t pread(void* out, size_t wanted, int64_t at) override {
    if (at < 0 || static_cast<uint64_t>(at) >= size_) return 0;
    const size_t count = std::min<uint64_t>(wanted, size_ - static_cast<uint64_t>(at));
    const std::span bytes(static_cast<std::byte*>(out), count);
    return file_.ReadAt(offset_ + static_cast<uint64_t>(at), bytes) ? count : 0;
  }

 private:
  const InputFile& file_;
  uint64_t offset_, size_;
};

/// OpenImageIO's name for the format, by the first bytes; by the extension only if they are not recognised.
/// OpenImageIO's other formats (films, raw photographs, volumes) are not tried.
std::string FormatOf(std::string_view start, const std::string& path) {
  const auto begins = [&](std::string_view magic) { return start.starts_with(magic); };
  using namespace std::string_view_literals;
  if (begins("\x89PNG\r\n")) return "png";
  if (begins("\xFF\xD8\xFF")) return "jpeg";
  if (begins("II*\0"sv) || begins("MM\0*"sv) || begins("II+\0"sv) || begins("MM\0+"sv)) return "tiff";
  if (begins("\x76\x2F\x31\x01")) return "openexr";
  if (begins("#?")) return "hdr";
  if (begins("BM")) return "bmp";
  if (begins("RIFF") && start.substr(std::min<size_t>(8, start.size())).starts_with("WEBP")) return "webp";
  if (start.size() > 2 && start[0] == 'P' &&
      ((start[1] >= '1' && start[1] <= '6') || start[1] == 'F' || start[1] == 'f'))
    return "pnm";
  std::string extension = std::filesystem::path(path).extension().string();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
  return extension == ".tga" ? "targa" : "";
}

/// One image, from its beginning to its last row.
class Decoding {
 public:
  Decoding(const OnFacts& on_facts, const OnRows& on_rows) : on_facts_(on_facts), on_rows_(on_rows) {}

  Result<std::string> Run(const std::string& path, uint64_t offset, uint64_t size, bool look_only) {
    QUARRY_ASSIGN(const InputFile file, InputFile::Open(path));
    if (offset > file.size()) return Fail("ends before its image begins");
    FilePart part(file, offset, std::min(size, file.size() - offset));
    QUARRY_TRY(OpenImage(part, path, file.size()));
    QUARRY_TRY(CheckFacts());
    on_facts_(facts_);
    if (look_only) return std::string();
    QUARRY_TRY(input_->spec().tile_width > 0 ? Tiles() : Scanlines());
    return input_->has_error() ? Refusal(input_->geterror()) : std::string();
  }

 private:
  /// Opens an image that lies inside another file.
  Status ReadFrom(FilePart& part, const std::string& format) {
    if (!input_->supports("ioproxy"))
      return Fail(fmt::format("is a {} inside another file, which is not read", format));
    if (format != "jpeg") {
      input_->set_ioproxy(&part);
      return {};
    }
    // This reader accepts only its own kind of file, and memory.
    packed_.resize(part.size());
    if (part.pread(packed_.data(), packed_.size(), 0) != packed_.size()) return Fail("ends too early");
    memory_.emplace(packed_.data(), packed_.size());
    input_->set_ioproxy(&*memory_);
    return {};
  }

  Status OpenImage(FilePart& part, const std::string& path, uint64_t whole) {
    std::string start(32, '\0');
    start.resize(part.pread(start.data(), start.size(), 0));
    const std::string format = FormatOf(start, path);
    if (format.empty())
      return Fail(
          "is not an image of a format that is read (PNG, JPEG, TIFF, EXR, HDR, BMP, TGA, PNM, WebP)");
    input_ = OIIO::ImageInput::create(format);
    if (!input_) return Fail(fmt::format("needs {}, which this OpenImageIO does not read", format));
    OIIO::ImageSpec config, spec;
    config["oiio:UnassociatedAlpha"] = 1;
    if (part.size() != whole) QUARRY_TRY(ReadFrom(part, format));
    if (!input_->open(path, spec, config)) return Fail(Refusal(input_->geterror()));
    if (format == "openexr" && (spec.x != spec.full_x || spec.y != spec.full_y ||
                                spec.width != spec.full_width || spec.height != spec.full_height))
      return Fail("has data for another window than its display window");
    // WebP's reader ignores the hint, and EXR's colours are always multiplied by alpha.
    multiplied_ = format == "webp" || format == "openexr" ||
                  (format == "tiff" && spec.get_int_attribute("oiio:UnassociatedAlpha") == 0);
    return {};
  }

  Status CheckFacts() {
    const OIIO::ImageSpec& spec = input_->spec();
    if (spec.deep || spec.depth > 1) return Fail("is a deep image or a volume");
    if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1) return Fail("has no pixels");
    if (static_cast<uint32_t>(spec.width) > kMaxTextureSide ||
        static_cast<uint32_t>(spec.height) > kMaxTextureSide)
      return Fail(fmt::format("is {} x {} pixels large, and at most {} a side are read", spec.width,
                              spec.height, kMaxTextureSide));
    const bool alpha = spec.alpha_channel >= 0;
    const int colors = spec.nchannels - alpha >= 3 ? 3 : 1;
    // Alpha directly after the colours, as in all formats but EXR with layers.
    with_alpha_ = spec.alpha_channel == colors;
    facts_.width = static_cast<uint32_t>(spec.width);
    facts_.height = static_cast<uint32_t>(spec.height);
    facts_.channels = static_cast<uint32_t>(colors + with_alpha_);
    facts_.in_file = static_cast<uint32_t>(spec.nchannels);
    facts_.real = spec.format.size() > 1;
    facts_.encoded = facts_.real && !spec.format.is_floating_point();
    return {};
  }

  /// Divides colours by alpha.
  void SendRows(Bytes& rows, size_t begin, size_t end) {
    const std::span part = std::span(rows).subspan(begin, end - begin);
    if (multiplied_ && with_alpha_) facts_.real ? Divide<float>(part) : Divide<uint8_t>(part);
    on_rows_(part);
  }

  template <class Sample>
  void Divide(std::span<std::byte> rows) const {
    constexpr bool kReal = std::is_same_v<Sample, float>;
    Sample texel[4];
    const size_t size = facts_.channels * sizeof(Sample), colors = facts_.channels - 1;
    for (size_t at = 0; at < rows.size(); at += size) {
      std::memcpy(texel, &rows[at], size);
      const Sample alpha = texel[colors];
      if (!(alpha > 0)) continue;
      for (size_t c = 0; c < colors; ++c) {
        if constexpr (kReal)
          texel[c] /= alpha;
        else
          texel[c] = static_cast<Sample>(std::min((texel[c] * 255 + alpha / 2) / alpha, 255));
      }
      std::memcpy(&rows[at], texel, size);
    }
  }

  OIIO::TypeDesc type() const { return facts_.real ? OIIO::TypeDesc::FLOAT : OIIO::TypeDesc::UINT8; }

  Status Scanlines() {
    const OIIO::ImageSpec& spec = input_->spec();
    const int at_once = static_cast<int>(std::clamp<uint64_t>(kRowsBytes / facts_.row_bytes(), 1, 64));
    Bytes rows;
    for (int y = spec.y; y < spec.y + spec.height; y += at_once) {
      const int end = std::min(y + at_once, spec.y + spec.height);
      rows.resize(facts_.row_bytes() * static_cast<uint64_t>(end - y));
      if (!input_->read_scanlines(0, 0, y, end, 0, 0, static_cast<int>(facts_.channels), type(), rows.data()))
        return Fail(Refusal(input_->geterror()));
      SendRows(rows, 0, rows.size());
    }
    return {};
  }

  /// Decodes a row of tiles at a time.
  Status Tiles() {
    const OIIO::ImageSpec& spec = input_->spec();
    Bytes rows;
    for (int y = spec.y; y < spec.y + spec.height; y += spec.tile_height) {
      const int end = std::min(y + spec.tile_height, spec.y + spec.height);
      rows.resize(facts_.row_bytes() * static_cast<uint64_t>(end - y));
      if (!input_->read_tiles(0, 0, spec.x, spec.x + spec.width, y, end, 0, 1, 0,
                              static_cast<int>(facts_.channels), type(), rows.data()))
        return Fail(Refusal(input_->geterror()));
      const uint64_t step = std::max<uint64_t>(kRowsBytes / facts_.row_bytes(), 1) * facts_.row_bytes();
      for (uint64_t at = 0; at < rows.size(); at += step)
        SendRows(rows, at, std::min<uint64_t>(at + step, rows.size()));
    }
    return {};
  }

  const OnFacts& on_facts_;
  const OnRows& on_rows_;
  Bytes packed_;  ///< an image's file, where the reader needs it in memory
  std::optional<OIIO::Filesystem::IOMemReader> memory_;
  std::unique_ptr<OIIO::ImageInput> input_;
  ImageFacts facts_;
  bool with_alpha_ = false, multiplied_ = false;  ///< there is alpha; colours are multiplied by it
};

}  // namespace

void PrepareDecoding() {
  OIIO::attribute("threads", 1);
  OIIO::attribute("exr_threads", -1);
  OIIO::attribute("plugin_searchpath", "");
  OIIO::attribute("limits:imagesize_MB", 16384);  // kMaxTextureSide squared, four floats
  OIIO::attribute("limits:channels", 64);
  OIIO::ImageInput::create("png");
}

Result<std::string> DecodeImage(const std::string& path, uint64_t offset, uint64_t size, bool look_only,
                                const OnFacts& on_facts, const OnRows& on_rows) {
  return Decoding(on_facts, on_rows).Run(path, offset, size, look_only);
}

std::string Refusal(const std::string& why) {
  std::string line = why.substr(0, std::min<size_t>(why.find('\n'), 300));
  return line.empty() ? "the decoder does not say why" : line;
}

}  // namespace quarry
