#include "preprocess/ingest/image_list.h"

#include <fmt/format.h>

#include "common/base/output_path.h"
#include "common/voxel/texture_shape.h"
#include "preprocess/import/file_identity.h"
#include "preprocess/spill/saved_tables.h"

namespace quarry {
std::string ImageList::KeyOf(const TextureImage& image) {
  return fmt::format("{} {} {} {} {}", image.offset, image.size, image.color,
                     static_cast<uint32_t>(image.pick), image.file);
}

Status ImageList::OpenFile(uint64_t size) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Continue(path_, path_, size));
  file_.emplace(std::move(file));
  return {};
}

Result<uint32_t> ImageList::Add(TextureImage image) {
  if (image.file.empty()) {
    if (!file_) QUARRY_TRY(OpenFile(0));
    image.file = path_;
    image.offset = file_->size();
    image.size = image.content.size();
    QUARRY_TRY(file_->Write(image.content));
    image.content = {};
  }
  const auto [it, added] = known_.emplace(KeyOf(image), static_cast<uint32_t>(images_.size()));
  if (!added) return it->second;
  if (images_.size() == kMaxTextures)
    return Fail(
        fmt::format("{}: more than {} images in all; --no-textures does without", image.model, kMaxTextures));
  NoteRead(image.file);  // later, by the decoder process
  identities_.push_back(image.file == path_ ? "" : FileIdentity(image.file));
  images_.push_back(std::move(image));
  return it->second;
}

Status ImageList::Save(ByteWriter& out) {
  if (file_) QUARRY_TRY(file_->Sync());
  out.Put(file_ ? file_->size() : uint64_t{0});
  out.Put(static_cast<uint32_t>(images_.size()));
  for (size_t i = 0; i < images_.size(); ++i) {
    const TextureImage& image = images_[i];
    PutTexts({image.file, image.name, image.model, identities_[i]}, out);
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
    texts.resize(4);
    image.file = texts[0];
    image.name = texts[1];
    image.model = texts[2];
    const std::string& identity = texts[3];
    image.offset = in.Get<uint64_t>();
    image.size = in.Get<uint64_t>();
    image.color = in.Get<uint8_t>() != 0;
    image.pick = static_cast<TexturePick>(in.Get<uint32_t>());
    if (!identity.empty() && FileIdentity(image.file) != identity)
      return CannotResume(fmt::format("{}: this image has changed since the run was begun", image.file));
    known_.emplace(KeyOf(image), static_cast<uint32_t>(images_.size()));
    images_.push_back(std::move(image));
    identities_.push_back(identity);
  }
  return bytes > 0 ? OpenFile(bytes) : Status{};
}

Result<std::vector<TextureImage>> ImageList::Finish() {
  if (file_) QUARRY_TRY(file_->Sync());
  return std::move(images_);
}

}  // namespace quarry
