#include "preprocess/texture/texture_stage.h"

#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <optional>

#include "common/base/resource.h"
#include "preprocess/texture/mip_builder.h"
#include "preprocess/texture/page_pipeline.h"
#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kSecondsPerCheckpoint = 1;

}  // namespace

Status TextureStage::Restore(std::span<const std::byte> checkpoint, std::vector<WrittenTexture>& textures) {
  ByteReader in(checkpoint);
  while (in.ok() && in.remaining() > 0) {
    if (in.Get<uint8_t>() == 0) {
      numbers_.push_back(kNoIndex);
      continue;
    }
    WrittenTexture t;
    t.texture.name = AsText(in.GetSpan(in.Get<uint32_t>()));
    t.texture.layout.width = in.Get<uint32_t>();
    t.texture.layout.height = in.Get<uint32_t>();
    t.texture.layout.channels = in.Get<uint32_t>();
    t.texture.layout.format = static_cast<TexelFormat>(in.Get<uint32_t>());
    const auto pages = in.Get<uint32_t>();
    t.texture.pages = in.GetArray<BlockEntry>(pages);
    t.logical = in.GetArray<uint64_t>(pages);
    numbers_.push_back(static_cast<uint32_t>(textures.size()));
    pages_ += pages;
    textures.push_back(std::move(t));
  }
  saved_ = numbers_.size();
  if (!in.ok() || numbers_.size() > images_.size()) return Fail("its journal cannot be read");
  return {};
}

Bytes TextureStage::TakeUnsaved(const StoreWriter& writer) {
  ByteWriter out;
  for (; saved_ < numbers_.size(); ++saved_) {
    const uint32_t number = numbers_[saved_];
    out.Put<uint8_t>(number != kNoIndex);
    if (number == kNoIndex) continue;
    const WrittenTexture& t = writer.textures()[number];
    out.Put(static_cast<uint32_t>(t.texture.name.size()));
    out.PutArray(t.texture.name);
    out.Put(t.texture.layout.width);
    out.Put(t.texture.layout.height);
    out.Put(t.texture.layout.channels);
    out.Put(static_cast<uint32_t>(t.texture.layout.format));
    out.Put(static_cast<uint32_t>(t.texture.pages.size()));
    out.PutArray(t.texture.pages);
    out.PutArray(t.logical);
  }
  return out.Take();
}

Status TextureStage::Run(StoreWriter& writer, Progress& progress,
                         const std::function<Status(const Bytes&)>& save) {
  if (images_.empty()) return {};
  const auto start = Clock::now();
  auto saved = start;
  progress.Begin(fmt::format("carrying {} images", images_.size()), "", numbers_.size());
  for (size_t i = numbers_.size(); i < images_.size(); ++i) {
    QUARRY_TRY(Carry(images_[i], writer));
    progress.Update(i + 1, images_.size());
    if (SecondsSince(saved) < kSecondsPerCheckpoint) continue;
    QUARRY_TRY(writer.Sync());
    QUARRY_TRY(save(TakeUnsaved(writer)));
    saved = Clock::now();
  }
  progress.End();
  wall_s_ = SecondsSince(start);
  return {};
}

Status TextureStage::Carry(const TextureImage& image, StoreWriter& writer) {
  std::optional<RowConverter> converter;
  std::optional<MipBuilder> mips;
  PagePipeline pages(writer, threads_);
  const auto on_facts = [&](const ImageFacts& facts) -> Status {
    const uint32_t more = TextureShape(facts.width, facts.height).pages();
    if (more > kMaxPages - pages_)
      return Fail(
          fmt::format("{}, image {}: with it, textures have more than {} pages; --no-textures does without",
                      image.model, image.name, kMaxPages));
    converter.emplace(facts, image.color, image.pick);
    writer.BeginTexture(image.name, converter->layout());
    mips.emplace(converter->layout(), [&pages](uint32_t page, std::span<const std::byte> texels) {
      return pages.Add(page, texels);
    });
    return {};
  };
  const auto on_row = [&](std::span<const std::byte> row) { return mips->AddRow(converter->Convert(row)); };
  Status carried = decoder_.Decode(image, on_facts, on_row);
  QUARRY_TRY(pages.Finish());
  if (!carried && decoder_.is_fatal()) return carried;
  if (carried) {
    numbers_.push_back(static_cast<uint32_t>(writer.textures().size() - 1));
    pages_ += static_cast<uint32_t>(writer.textures().back().texture.pages.size());
    return {};
  }
  if (mips) QUARRY_TRY(writer.DropTexture());
  numbers_.push_back(kNoIndex);
  warn_(carried.error().message + "; materials do without");
  return {};
}

void TextureStage::Renumber(std::vector<Material>& materials) const {
  for (Material& material : materials) {
    for (TextureBinding& binding : material.textures) binding.texture = numbers_[binding.texture];
    std::erase_if(material.textures, [](const TextureBinding& b) { return b.texture == kNoIndex; });
  }
}

TextureStatistics TextureStage::Statistics(const StoreWriter& writer) const {
  TextureStatistics statistics;
  statistics.textures = writer.textures().size();
  statistics.left_out = numbers_.size() - writer.textures().size();
  for (const WrittenTexture& t : writer.textures()) {
    statistics.pages += t.texture.pages.size();
    for (const BlockEntry& page : t.texture.pages) {
      statistics.stored_bytes += page.stored;
      statistics.decoded_bytes += page.decoded;
    }
  }
  statistics.wall_s = wall_s_;
  return statistics;
}

}  // namespace quarry
