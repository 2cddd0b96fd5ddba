#include "common/voxel/texture_sections.h"

#include <fmt/format.h>

#include <cmath>

namespace quarry {
namespace {

constexpr size_t kPageBytes = 24, kMaterialTextureBytes = 64;
/// Bytes before a stored page's streams: their size.
constexpr uint32_t kMostStoredOverStreams = 4;

void PutFacts(const TexelLayout& layout, ByteWriter& out) {
  out.Put(layout.width);
  out.Put(layout.height);
  out.Put(layout.channels);
  out.Put(static_cast<uint32_t>(layout.format));
}

Status CheckPage(const BlockEntry& page, uint64_t decoded, uint64_t begin, uint64_t end) {
  if (page.decoded != decoded || page.stored == 0 || page.stored > decoded + kMostStoredOverStreams ||
      page.offset < begin || page.offset > end || page.stored > end - page.offset)
    return Fail("a page of an invalid size or place");
  return {};
}

Status ReadPages(ByteReader& in, Texture& texture, uint64_t begin, uint64_t end) {
  const TextureShape shape(texture.layout.width, texture.layout.height);
  if (in.remaining() / kPageBytes < shape.pages()) return Fail("fewer pages than it has");
  texture.pages.resize(shape.pages());
  for (uint32_t p = 0; p < shape.pages(); ++p) {
    BlockEntry& page = texture.pages[p];
    page.offset = in.Get<uint64_t>();
    page.stored = in.Get<uint32_t>();
    page.decoded = in.Get<uint32_t>();
    page.checksum = in.Get<uint64_t>();
    QUARRY_TRY(CheckPage(page, uint64_t{shape.TexelsOf(p)} * texture.layout.texel_bytes(), begin, end));
  }
  return {};
}

bool Sane(const TextureBinding& b) {
  bool finite = b.cutoff >= 0 && b.cutoff <= 1e30f;
  for (const float x : b.transform) finite = finite && std::isfinite(x);
  for (int i = 0; i < 4; ++i) finite = finite && std::isfinite(b.factor[i]);
  return finite && static_cast<uint32_t>(b.use) < kTextureUses &&
         static_cast<uint32_t>(b.wrap_s) < kTextureWraps && static_cast<uint32_t>(b.wrap_t) < kTextureWraps;
}

}  // namespace

Bytes EncodeTextures(const std::vector<Texture>& textures, std::string& strings) {
  ByteWriter out;
  out.Put(static_cast<uint32_t>(textures.size()));
  for (const Texture& t : textures) {
    out.Put(static_cast<uint32_t>(strings.size()));
    strings.append(t.name).push_back('\0');
    PutFacts(t.layout, out);
  }
  for (const Texture& t : textures) {
    for (const BlockEntry& page : t.pages) {
      out.Put(page.offset);
      out.Put(page.stored);
      out.Put(page.decoded);
      out.Put(page.checksum);
    }
  }
  return out.Take();
}

Bytes EncodeTextureFacts(const std::vector<Texture>& textures) {
  ByteWriter out;
  for (const Texture& t : textures) PutFacts(t.layout, out);
  return out.Take();
}

void PutBinding(const TextureBinding& b, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(b.use));
  out.Put(b.texture);
  out.Put(static_cast<uint32_t>(b.wrap_s));
  out.Put(static_cast<uint32_t>(b.wrap_t));
  out.PutArray(b.transform);
  for (int i = 0; i < 4; ++i) out.Put(b.factor[i]);
  out.Put(b.cutoff);
}

TextureBinding GetBinding(ByteReader& in) {
  TextureBinding b;
  b.use = static_cast<TextureUse>(in.Get<uint32_t>());
  b.texture = in.Get<uint32_t>();
  b.wrap_s = static_cast<TextureWrap>(in.Get<uint32_t>());
  b.wrap_t = static_cast<TextureWrap>(in.Get<uint32_t>());
  for (float& x : b.transform) x = in.Get<float>();
  for (int i = 0; i < 4; ++i) b.factor[i] = in.Get<float>();
  b.cutoff = in.Get<float>();
  return b;
}

Bytes EncodeMaterialTextures(const std::vector<Material>& materials) {
  ByteWriter out;
  for (size_t m = 0; m < materials.size(); ++m) {
    for (const TextureBinding& binding : materials[m].textures) {
      out.Put(static_cast<uint32_t>(m));
      PutBinding(binding, out);
    }
  }
  return out.Take();
}

Result<std::vector<Texture>> DecodeTextures(std::span<const std::byte> bytes, uint64_t begin, uint64_t end) {
  ByteReader in(bytes);
  const auto count = in.Get<uint32_t>();
  if (!in.ok() || count > kMaxTextures || in.remaining() / kTextureBytes < count)
    return Fail("the TEXD section has the wrong size");
  std::vector<Texture> textures(count);
  uint64_t pages = 0;
  for (size_t i = 0; i < count; ++i) {
    TexelLayout& layout = textures[i].layout;
    in.Get<uint32_t>();  // the name, which StoreNames gives
    layout.width = in.Get<uint32_t>();
    layout.height = in.Get<uint32_t>();
    layout.channels = in.Get<uint32_t>();
    layout.format = static_cast<TexelFormat>(in.Get<uint32_t>());
    if (const Status sane = CheckTexelLayout(layout); !sane)
      return Fail(fmt::format("the TEXD section's texture {} has {}", i, sane.error().message));
    pages += TextureShape(layout.width, layout.height).pages();
  }
  if (pages > kMaxPages) return Fail("the TEXD section has too many pages");
  for (size_t i = 0; i < count; ++i)
    if (const Status read = ReadPages(in, textures[i], begin, end); !read)
      return Fail(fmt::format("the TEXD section's texture {} has {}", i, read.error().message));
  if (!in.done()) return Fail("the TEXD section has the wrong size");
  return textures;
}

Result<std::vector<MaterialTexture>> DecodeMaterialTextures(std::span<const std::byte> bytes,
                                                            size_t materials, size_t textures) {
  if (bytes.size() % kMaterialTextureBytes != 0 ||
      bytes.size() / kMaterialTextureBytes > materials * kTextureUses)
    return Fail("the MTEX section has the wrong size");
  ByteReader in(bytes);
  std::vector<MaterialTexture> uses(bytes.size() / kMaterialTextureBytes);
  uint64_t before = 0;
  for (size_t i = 0; i < uses.size(); ++i) {
    uses[i].material = in.Get<uint32_t>();
    uses[i].binding = GetBinding(in);
    const TextureBinding& b = uses[i].binding;
    const uint64_t order = uint64_t{uses[i].material} << 32 | static_cast<uint32_t>(b.use);
    if (uses[i].material >= materials || b.texture >= textures || !Sane(b) || (i != 0 && order <= before))
      return Fail(fmt::format("the MTEX section's entry {} is invalid", i));
    before = order;
  }
  return uses;
}

}  // namespace quarry
