#include "preprocess/texture/texture_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/resource.h"
#include "common/scene/open_pbr.h"
#include "preprocess/texture/mip_builder.h"
#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

/// Undoes the effect of opacity on the material's numbers: its texture gives the opacity instead.
void MakeSolid(Material& m) {
  if (m.geometry_opacity >= 1 || m.geometry_opacity <= 0) return;
  if (m.is_open_pbr) {
    m.geometry_opacity = 1;
    return DeriveWhitted(m, m.ior > 1);
  }
  m.diffuse /= m.geometry_opacity;
  m.transmittance = glm::vec3(0);
  DeriveOpenPbr(m);
}

using Clock = std::chrono::steady_clock;

constexpr double kSecondsPerCheckpoint = 1;

/// Whether the mean of an image's texels is that of a normal map: straight up, give or take.
bool IsOfNormals(std::span<const std::byte> texel, const TexelLayout& layout) {
  constexpr float kAside = 0.15f, kLeastBlue = 0.75f;
  if (layout.format != TexelFormat::kLinear8 || layout.channels < 3) return false;
  const auto channel = [&](size_t c) { return static_cast<float>(texel[c]) / 255; };
  return std::fabs(channel(0) - 0.5f) < kAside && std::fabs(channel(1) - 0.5f) < kAside &&
         channel(2) > kLeastBlue;
}

/// The outcome of an image, as a checkpoint has it.
enum class Carried : uint8_t { kLeftOut, kTexture, kShared };

}  // namespace

Status TextureStage::Restore(std::span<const std::byte> checkpoint, std::vector<WrittenTexture>& textures) {
  ByteReader in(checkpoint);
  while (in.ok() && in.remaining() > 0) {
    const auto carried = static_cast<Carried>(in.Get<uint8_t>());
    if (carried == Carried::kLeftOut || carried == Carried::kShared) {
      numbers_.push_back(carried == Carried::kShared ? in.Get<uint32_t>() : kNoIndex);
      if (carried == Carried::kShared && numbers_.back() >= textures.size())
        return Fail("its journal cannot be read");
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
    const auto number = static_cast<uint32_t>(textures.size());
    numbers_.push_back(number);
    pages_ += pages;
    of_normals_.push_back(in.Get<uint8_t>() != 0);
    Know(t, number);
    textures.push_back(std::move(t));
  }
  saved_ = numbers_.size();
  saved_textures_ = static_cast<uint32_t>(textures.size());
  if (!in.ok() || numbers_.size() > images_.size()) return Fail("its journal cannot be read");
  return {};
}

Bytes TextureStage::TakeUnsaved(const StoreWriter& writer) {
  ByteWriter out;
  for (; saved_ < numbers_.size(); ++saved_) {
    const uint32_t number = numbers_[saved_];
    const Carried carried = number == kNoIndex         ? Carried::kLeftOut
                            : number < saved_textures_ ? Carried::kShared
                                                       : Carried::kTexture;
    out.Put(static_cast<uint8_t>(carried));
    if (carried == Carried::kShared) out.Put(number);
    if (carried != Carried::kTexture) continue;
    ++saved_textures_;
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
    out.Put<uint8_t>(of_normals_[number]);
  }
  return out.Take();
}

Status TextureStage::Run(StoreWriter& writer, Progress& progress,
                         const std::function<Status(const Bytes&)>& save) {
  if (images_.empty()) return {};
  const auto start = Clock::now();
  auto saved = start;
  progress.Begin(fmt::format("carrying {} images", images_.size()), "", numbers_.size());
  ImageReader reader(images_, numbers_.size(), decoding_);
  PagePipeline pages(writer, threads_);
  for (size_t i = numbers_.size(); i < images_.size(); ++i) {
    QUARRY_TRY(Carry(images_[i], reader, pages, writer));
    QUARRY_TRY(pages.Then([&]() -> Status {
      progress.Update(numbers_.size(), images_.size());
      if (SecondsSince(saved) < kSecondsPerCheckpoint) return {};
      QUARRY_TRY(writer.Flush());
      QUARRY_TRY(save(TakeUnsaved(writer)));
      saved = Clock::now();
      return {};
    }));
  }
  QUARRY_TRY(pages.Finish());
  progress.End();
  wall_s_ = SecondsSince(start);
  return {};
}

/// Makes the pages of an image; the pipeline's steps note its outcome.
Status TextureStage::Carry(const TextureImage& image, ImageReader& reader, PagePipeline& pages,
                           StoreWriter& writer) {
  std::optional<RowConverter> converter;
  std::optional<MipBuilder> mips;
  bool of_normals = false;
  for (;;) {
    ImageReader::Piece piece = reader.Next();
    switch (piece.kind) {
      case ImageReader::Piece::Kind::kFacts: {
        converter.emplace(piece.facts, image.color, image.pick);
        const TexelLayout layout = converter->layout();
        QUARRY_TRY(pages.Then([this, &image, &writer, layout] { return Begin(image, layout, writer); }));
        pages.Begin(layout);
        const uint32_t last = TextureShape(layout.width, layout.height).pages() - 1;
        mips.emplace(layout,
                     [&pages, &of_normals, layout, last](uint32_t page, std::span<const std::byte> texels) {
                       // The tail ends with the level of one texel, the mean.
                       if (page == last) of_normals = IsOfNormals(texels.last(layout.texel_bytes()), layout);
                       return pages.Add(page, texels);
                     });
        break;
      }
      case ImageReader::Piece::Kind::kRows: {
        const size_t row = converter->row_bytes();
        for (size_t at = 0; at < piece.rows.size(); at += row)
          QUARRY_TRY(mips->AddRow(converter->Convert(std::span(piece.rows).subspan(at, row))));
        break;
      }
      case ImageReader::Piece::Kind::kEnd:
        if (piece.status)
          return pages.Then([this, &writer, of_normals, remark = piece.remark] {
            if (!remark.empty()) warn_(remark);
            return Settle(of_normals, writer);
          });
        if (piece.fatal) return piece.status;
        return pages.Then(
            [this, &writer, begun = mips.has_value(), error = piece.status.error()]() -> Status {
              if (begun) QUARRY_TRY(writer.DropTexture());
              numbers_.push_back(kNoIndex);
              warn_(error.message + "; materials do without them");
              return {};
            });
    }
  }
}

Status TextureStage::Begin(const TextureImage& image, const TexelLayout& layout, StoreWriter& writer) const {
  if (TextureShape(layout.width, layout.height).pages() > kMaxPages - pages_)
    return Fail(
        fmt::format("{}, image {}: with it, textures have more than {} pages; --no-textures leaves them out",
                    image.model, image.name, kMaxPages));
  writer.BeginTexture(image.name, layout);
  return {};
}

/// Keeps the texture written last, unless it is there already.
Status TextureStage::Settle(bool of_normals, StoreWriter& writer) {
  const auto number = static_cast<uint32_t>(writer.textures().size() - 1);
  const WrittenTexture& last = writer.textures().back();
  const uint32_t equal = FindEqual(last, std::span(writer.textures()).first(number));
  numbers_.push_back(equal == kNoIndex ? number : equal);
  if (equal != kNoIndex) return writer.DropTexture();
  pages_ += static_cast<uint32_t>(last.texture.pages.size());
  of_normals_.push_back(of_normals);
  Know(last, number);
  return {};
}

/// The earlier texture with the same texels, or kNoIndex. Pages of equal checksums are equal.
uint32_t TextureStage::FindEqual(const WrittenTexture& texture,
                                 std::span<const WrittenTexture> earlier) const {
  const auto [begin, end] = texels_.equal_range(Checksum(std::as_bytes(std::span(texture.logical))));
  const auto it = std::find_if(begin, end, [&](const auto& entry) {
    const WrittenTexture& other = earlier[entry.second];
    return other.texture.layout == texture.texture.layout && other.logical == texture.logical;
  });
  return it == end ? kNoIndex : it->second;
}

void TextureStage::Know(const WrittenTexture& texture, uint32_t number) {
  texels_.emplace(Checksum(std::as_bytes(std::span(texture.logical))), number);
}

void TextureStage::Renumber(std::vector<Material>& materials, const StoreWriter& writer) const {
  const auto left_out = [&](const TextureBinding& b) {
    const uint32_t number = numbers_[b.texture];
    return number == kNoIndex ||
           (b.use == TextureUse::kOpacity &&
            !HasOpacity(writer.textures()[number].texture.layout, images_[b.texture].pick));
  };
  const auto use_of = &TextureBinding::use;
  for (Material& material : materials) {
    std::vector<TextureBinding>& textures = material.textures;
    std::erase_if(textures, left_out);
    for (TextureBinding& binding : textures) binding.texture = numbers_[binding.texture];
    if (std::ranges::find(textures, TextureUse::kOpacity, use_of) != textures.end()) MakeSolid(material);
    const auto bump = std::ranges::find(textures, TextureUse::kBump, use_of);
    if (bump == textures.end() || !of_normals_[bump->texture]) continue;
    if (std::ranges::find(textures, TextureUse::kNormal, use_of) == textures.end())
      bump->use = TextureUse::kNormal;
    else
      textures.erase(bump);
  }
}

TextureStatistics TextureStage::Statistics(const StoreWriter& writer) const {
  TextureStatistics statistics;
  statistics.textures = writer.textures().size();
  statistics.left_out = static_cast<uint64_t>(std::ranges::count(numbers_, kNoIndex));
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
