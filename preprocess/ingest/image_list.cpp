#include "preprocess/ingest/image_list.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <system_error>

#include "common/base/output_path.h"
#include "common/voxel/texture_shape.h"
#include "preprocess/import/files/model_files.h"
#include "preprocess/spill/saved_tables.h"

namespace quarry {
namespace {

/// Bytes of the image; 0 if they cannot be read, as of an image that is empty.
uint64_t SizeOf(const TextureImage& image) {
  if (image.size != TextureImage::kToTheEnd) return image.size;
  std::error_code none;
  const uintmax_t bytes = std::filesystem::file_size(image.file, none);
  return none || bytes < image.offset ? 0 : bytes - image.offset;
}

/// XXH3, 128 bits, as text.
class Digest {
 public:
  Digest() { XXH3_128bits_reset(state_.get()); }
  void Add(std::span<const std::byte> bytes) {
    XXH3_128bits_update(state_.get(), bytes.data(), bytes.size());
  }
  std::string Text() const {
    const XXH128_hash_t hash = XXH3_128bits_digest(state_.get());
    return fmt::format("{:016x}{:016x}", hash.high64, hash.low64);
  }

 private:
  std::unique_ptr<XXH3_state_t, decltype(&XXH3_freeState)> state_{XXH3_createState(), XXH3_freeState};
};

/// The digest of the image's bytes in its file; a text that no other image has if they cannot be read.
std::string DigestOf(const TextureImage& image, uint64_t size) {
  constexpr uint64_t kPiece = 1 << 20;
  std::string unreadable = fmt::format("{} {}", image.file, image.offset);
  const auto file = InputFile::Open(image.file);
  if (!file) return unreadable;
  Digest digest;
  Bytes piece(std::min(size, kPiece));
  for (uint64_t at = 0; at < size; at += kPiece) {
    const std::span part = std::span(piece).first(std::min(size - at, kPiece));
    if (!file->ReadAt(image.offset + at, part)) return unreadable;
    digest.Add(part);
  }
  return digest.Text();
}

}  // namespace

std::string ImageList::KeyOf(const TextureImage& image) {
  return fmt::format("{} {} {} {} {}", image.offset, image.size, image.color,
                     static_cast<uint32_t>(image.pick), image.file);
}

Status ImageList::OpenFile(uint64_t size) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Continue(path_, path_, size));
  file_.emplace(std::move(file));
  return {};
}

/// The image for the same use that has the same bytes, or kNoIndex. Fills `content` in.
uint32_t ImageList::FindEqual(const TextureImage& image, Content& content) {
  content.size = image.file.empty() ? image.content.size() : SizeOf(image);
  if (content.size == 0) return kNoIndex;
  if (image.file.empty()) {  // now: once appended, the bytes may not be in the file yet
    Digest digest;
    digest.Add(image.content);
    content.digest = digest.Text();
  }
  uint32_t equal = kNoIndex;
  const auto [begin, end] = sized_.equal_range(content.size);
  for (auto it = begin; it != end; ++it) {
    const TextureImage& other = images_[it->second];
    if (other.color != image.color || other.pick != image.pick) continue;
    std::string& digest = contents_[it->second].digest;
    if (digest.empty()) digest = DigestOf(other, content.size);
    if (content.digest.empty()) content.digest = DigestOf(image, content.size);
    if (digest == content.digest) equal = std::min(equal, it->second);
  }
  return equal;
}

void ImageList::Know(TextureImage image, Content content) {
  const auto number = static_cast<uint32_t>(images_.size());
  known_.emplace(KeyOf(image), number);
  sized_.emplace(content.size, number);
  contents_.push_back(std::move(content));
  images_.push_back(std::move(image));
}

Result<uint32_t> ImageList::Add(TextureImage image) {
  const std::string key = KeyOf(image);
  const bool has_file = !image.file.empty();
  if (const auto it = known_.find(key); has_file && it != known_.end()) return it->second;
  // Images beside the list's own file were taken out of a model: they go with the run.
  const bool own =
      has_file &&
      std::filesystem::path(image.file).parent_path() == std::filesystem::path(path_).parent_path() &&
      image.file.find(".image-") != std::string::npos;
  Content content;
  const uint32_t equal = FindEqual(image, content);
  if (has_file && !own) {
    NoteModelFile(image.file);
    NoteRead(image.file);  // later, by the decoder process
  }
  if (equal != kNoIndex) {
    if (has_file) known_.emplace(key, equal);
    return equal;
  }
  if (images_.size() == kMaxTextures)
    return Fail(fmt::format("{}: more than {} images in all; --no-textures leaves them out", image.model,
                            kMaxTextures));
  if (!has_file) {
    if (!file_) QUARRY_TRY(OpenFile(0));
    image.file = path_;
    image.offset = file_->size();
    image.size = image.content.size();
    QUARRY_TRY(file_->Write(image.content));
    image.content = {};
  }
  Know(std::move(image), std::move(content));
  return static_cast<uint32_t>(images_.size() - 1);
}

Status ImageList::Save(ByteWriter& out) {
  if (file_) QUARRY_TRY(file_->Flush());
  out.Put(file_ ? file_->size() : uint64_t{0});
  out.Put(static_cast<uint32_t>(images_.size()));
  for (const TextureImage& image : images_) {
    PutTexts({image.file, image.name, image.model}, out);
    out.Put(image.offset);
    out.Put(image.size);
    out.Put<uint8_t>(image.color);
    out.Put(static_cast<uint32_t>(image.pick));
  }
  return {};
}

Status ImageList::Restore(ByteReader& in) {
  const auto bytes = in.Get<uint64_t>();
  for (auto n = in.Get<uint32_t>(); n > 0 && in.ok(); --n) {
    TextureImage image;
    std::vector<std::string> texts = GetTexts(in);
    texts.resize(3);
    image.file = texts[0];
    image.name = texts[1];
    image.model = texts[2];
    image.offset = in.Get<uint64_t>();
    image.size = in.Get<uint64_t>();
    image.color = in.Get<uint8_t>() != 0;
    image.pick = static_cast<TexturePick>(in.Get<uint32_t>());
    images_.push_back(std::move(image));
  }
  return bytes > 0 ? OpenFile(bytes) : Status{};
}

Result<std::vector<TextureImage>> ImageList::Finish() {
  if (file_) QUARRY_TRY(file_->Flush());
  return std::move(images_);
}

}  // namespace quarry
